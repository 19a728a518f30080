//! The 3 × 3 block of a point, by QR of its rows: backward stable in `f32`, where a Cholesky factor of `JᵀJ` is not.
//! Whole points go through modified Gram–Schmidt, single rows and the damping through Givens rotations.
//!
//! Source: `solver.md` §1.3 b. `R` is upper triangular, stored `[r00, r01, r02, r11, r12, r22]`, with `RᵀR = J_pᵀJ_p`.

use epipole_geometry::camera::Real;

use super::small::Vec3;

/// Upper triangle of a 3 × 3 matrix by rows.
pub(super) type Triangle<T> = [T; 6];

/// Ratio of the diagonal of `R` beyond which a point has no position (source: `solver.md` §5.4): rays that are parallel
/// to within 1e-6 rad.
const RANK_RATIO: f64 = 1e6;

/// `R` of the rows whose columns are given; they are overwritten. Modified Gram–Schmidt: its `R` is backward stable like
/// that of Givens rotations (source: Björck 1967), and takes three roots a point instead of six an observation.
pub(super) fn triangle(columns: &mut [Vec<f64>; 3]) -> Triangle<f64> {
    let [a, b, c] = columns;
    let (mut aa, mut ab, mut ac) = (0.0, 0.0, 0.0);
    for ((a, b), c) in a.iter().zip(b.iter()).zip(c.iter()) {
        aa += a * a;
        ab += a * b;
        ac += a * c;
    }
    let inverse = if aa > 0.0 { 1.0 / aa } else { 0.0 };
    let (along_b, along_c) = (ab * inverse, ac * inverse);
    let (mut bb, mut bc) = (0.0, 0.0);
    for ((a, b), c) in a.iter().zip(b.iter_mut()).zip(c.iter_mut()) {
        *b -= along_b * a;
        *c -= along_c * a;
        bb += *b * *b;
        bc += *b * *c;
    }
    let along_bc = if bb > 0.0 { bc / bb } else { 0.0 };
    let mut cc = 0.0;
    for (b, c) in b.iter().zip(c.iter()) {
        let rest = c - along_bc * b;
        cc += rest * rest;
    }
    let (r00, r11) = (aa.sqrt(), bb.sqrt());
    [r00, along_b * r00, along_c * r00, r11, along_bc * r11, cc.sqrt()]
}

/// Folds one row of `J_p` into `R`.
#[inline(always)]
pub(super) fn fold_row<T: Real>(r: &mut Triangle<T>, mut row: Vec3<T>) {
    rotate(&mut r[0..3], &mut row, 0);
    rotate(&mut r[3..5], &mut row, 1);
    rotate(&mut r[5..6], &mut row, 2);
}

#[inline(always)]
fn rotate<T: Real>(line: &mut [T], row: &mut Vec3<T>, from: usize) {
    let (a, b) = (line[0], row[from]);
    if b == T::ZERO {
        return;
    }
    let norm = (a * a + b * b).sqrt();
    let inverse = T::ONE / norm;
    let (c, s) = (a * inverse, b * inverse);
    line[0] = norm;
    for k in 1..line.len() {
        let (x, y) = (line[k], row[from + k]);
        line[k] = c * x + s * y;
        row[from + k] = c * y - s * x;
    }
}

/// Squared norms of the columns of `R`, which are those of `J_p`.
#[inline(always)]
pub(super) fn column_norms_squared<T: Real>(r: &Triangle<T>) -> Vec3<T> {
    [r[0] * r[0], r[1] * r[1] + r[3] * r[3], r[2] * r[2] + r[4] * r[4] + r[5] * r[5]]
}

/// Whether the observations fix a position.
pub(super) fn has_full_rank<T: Real>(r: &Triangle<T>) -> bool {
    let diagonal = [r[0].to_f64(), r[3].to_f64(), r[5].to_f64()].map(f64::abs);
    let (low, high) = diagonal.iter().fold((f64::MAX, 0.0f64), |(low, high), &d| (low.min(d), high.max(d)));
    low * RANK_RATIO > high
}

/// `R̃` with `R̃ᵀR̃ = RᵀR + λ diag(RᵀR)`, with the **reciprocals** of its diagonal in place of the diagonal.
#[inline(always)]
pub(super) fn damp<T: Real>(r: &Triangle<T>, sqrt_lambda: T) -> Triangle<T> {
    let norms = column_norms_squared(r);
    let mut out = *r;
    for k in 0..3 {
        let mut row = [T::ZERO; 3];
        row[k] = sqrt_lambda * norms[k].sqrt();
        fold_row(&mut out, row);
    }
    for k in [0, 3, 5] {
        out[k] = T::ONE / out[k];
    }
    out
}

/// `v R̃⁻¹`.
#[inline(always)]
pub(super) fn solve_row<T: Real>(r: &Triangle<T>, v: &Vec3<T>) -> Vec3<T> {
    let a = v[0] * r[0];
    let b = (v[1] - a * r[1]) * r[3];
    [a, b, (v[2] - a * r[2] - b * r[4]) * r[5]]
}

/// `(R̃ᵀR̃)⁻¹ g`.
#[inline(always)]
pub(super) fn solve_normal<T: Real>(r: &Triangle<T>, g: &Vec3<T>) -> Vec3<T> {
    let y = solve_row(r, g);
    let c = y[2] * r[5];
    let b = (y[1] - r[4] * c) * r[3];
    [(y[0] - r[1] * b - r[2] * c) * r[0], b, c]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damped_triangle_solves_the_damped_normal_equations() {
        let rows = [[1.0, 2.0, -0.5], [0.3, -1.0, 4.0], [2.0, 0.1, 0.2], [-1.0, 1.0, 1.0f64]];
        let lambda: f64 = 0.01;
        let mut r = [0.0; 6];
        let mut normal = [[0.0; 3]; 3];
        for row in rows {
            fold_row(&mut r, row);
            for i in 0..3 {
                for j in 0..3 {
                    normal[i][j] += row[i] * row[j];
                }
            }
        }
        assert!(has_full_rank(&r));
        let g = [0.7, -2.0, 1.1];
        let x = solve_normal(&damp(&r, lambda.sqrt()), &g);
        for i in 0..3 {
            let mut product: f64 = (0..3).map(|j| normal[i][j] * x[j]).sum();
            product += lambda * normal[i][i] * x[i];
            assert!((product - g[i]).abs() < 1e-12, "{product} {}", g[i]);
        }
    }

    #[test]
    fn parallel_rays_have_no_position() {
        let mut r = [0.0f64; 6];
        for _ in 0..4 {
            fold_row(&mut r, [1.0, 0.0, 0.5]);
            fold_row(&mut r, [0.0, 1.0, -0.25]);
        }
        assert!(!has_full_rank(&r));
    }
}
