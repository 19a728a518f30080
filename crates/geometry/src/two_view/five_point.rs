//! The essential matrix from five correspondences.
//!
//! Source: D. Nistér, "An efficient solution to the five-point relative pose problem", PAMI 2004: the null space of the
//! epipolar rows, the ten cubic constraints on E, Gauss–Jordan elimination and a polynomial of degree ten.

use glam::{DMat3, DVec3};

use super::null_space;
use super::polynomial::real_roots;

/// A linear form in x, y, z, 1.
type Linear = [f64; 4];
/// x², y², z², xy, xz, yz, x, y, z, 1.
type Quadratic = [f64; 10];
/// The monomials of [`CUBIC`], in the order that leaves the unknowns x and y in the right places after elimination.
type Cubic = [f64; 20];

const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;
const ONE: usize = 3;

/// Exponents of x, y and z of each quadratic monomial.
const QUADRATIC: [[u8; 3]; 10] =
    [[2, 0, 0], [0, 2, 0], [0, 0, 2], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]];

/// Exponents of x, y and z of each cubic monomial, in Nistér's order.
const CUBIC: [[u8; 3]; 20] = [
    [3, 0, 0],
    [0, 3, 0],
    [2, 1, 0],
    [1, 2, 0],
    [2, 0, 1],
    [2, 0, 0],
    [0, 2, 1],
    [0, 2, 0],
    [1, 1, 1],
    [1, 1, 0],
    [1, 0, 2],
    [1, 0, 1],
    [1, 0, 0],
    [0, 1, 2],
    [0, 1, 1],
    [0, 1, 0],
    [0, 0, 3],
    [0, 0, 2],
    [0, 0, 1],
    [0, 0, 0],
];

/// Where the product of quadratic monomial `q` and linear monomial `l` lands among the cubic ones.
const PRODUCT: [[usize; 4]; 10] = {
    let mut table = [[0; 4]; 10];
    let mut q = 0;
    while q < 10 {
        let mut l = 0;
        while l < 4 {
            let mut e = QUADRATIC[q];
            if l < ONE {
                e[l] += 1;
            }
            let mut c = 0;
            while CUBIC[c][0] != e[0] || CUBIC[c][1] != e[1] || CUBIC[c][2] != e[2] {
                c += 1;
            }
            table[q][l] = c;
            l += 1;
        }
        q += 1;
    }
    table
};

/// Appends to `solutions` the essential matrices E (at most ten, of Frobenius norm √2) with
/// `ray2ᵀ E ray1 = 0` for five pairs of rays in the two camera frames, of any length.
///
/// Nothing is appended where the five pairs leave more than the four directions of the general case open
/// (repeated pairs, or rays that are not finite).
pub fn five_point(rays1: &[DVec3; 5], rays2: &[DVec3; 5], solutions: &mut Vec<DMat3>) {
    let rows: [[f64; 9]; 5] = std::array::from_fn(|i| epipolar_row(rays1[i], rays2[i]));
    let Some(basis) = null_space::minimal::<5, 4>(&rows) else { return };
    let Some(reduced) = eliminate(constraints(&basis)) else { return };

    // Rows x²z, x², y²z, y², xyz, xy; each pair gives one row of B(z) · (x, y, 1) = 0 with degrees 3, 3 and 4.
    let mut b = [[[0.0; 5]; 3]; 3];
    for (k, row) in b.iter_mut().enumerate() {
        let (with_z, without_z) = (&reduced[2 * k], &reduced[2 * k + 1]);
        for (column, (offset, degree)) in [(0, 2), (3, 2), (6, 3)].into_iter().enumerate() {
            for power in 0..=degree {
                let at = offset + degree - power;
                row[column][power] += with_z[at];
                row[column][power + 1] -= without_z[at];
            }
        }
    }
    for &z in real_roots(&determinant(&b)).as_slice() {
        let Some([x, y]) = null_vector(&b, z) else { continue };
        let coefficients = [x, y, z, 1.0];
        let mut e = [0.0; 9];
        for (c, vector) in coefficients.iter().zip(&basis) {
            for i in 0..9 {
                e[i] += c * vector[i];
            }
        }
        // Unit baseline: the two singular values are 1.
        let scale = std::f64::consts::SQRT_2 / coefficients.iter().map(|c| c * c).sum::<f64>().sqrt();
        let matrix = row_major(&e) * scale;
        if matrix.is_finite() {
            solutions.push(matrix);
        }
    }
}

/// The row of `ray2ᵀ E ray1 = 0` for E in row-major order.
#[inline(always)]
pub(super) fn epipolar_row(ray1: DVec3, ray2: DVec3) -> [f64; 9] {
    let (a, b, c) = (ray1 * ray2.x, ray1 * ray2.y, ray1 * ray2.z);
    [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]
}

/// A matrix from nine numbers, row by row.
#[inline(always)]
pub(super) fn row_major(m: &[f64; 9]) -> DMat3 {
    DMat3::from_cols_array(m).transpose()
}

fn linear_product(a: &Linear, b: &Linear, sign: f64, out: &mut Quadratic) {
    for i in 0..3 {
        out[i] += sign * a[i] * b[i];
        out[6 + i] += sign * (a[i] * b[ONE] + a[ONE] * b[i]);
    }
    out[3] += sign * (a[X] * b[Y] + a[Y] * b[X]);
    out[4] += sign * (a[X] * b[Z] + a[Z] * b[X]);
    out[5] += sign * (a[Y] * b[Z] + a[Z] * b[Y]);
    out[9] += sign * a[ONE] * b[ONE];
}

fn cubic_product(q: &Quadratic, l: &Linear, out: &mut Cubic) {
    for i in 0..10 {
        for j in 0..4 {
            out[PRODUCT[i][j]] += q[i] * l[j];
        }
    }
}

/// det E = 0 and (E Eᵀ − ½ tr(E Eᵀ) I) E = 0 as ten cubics in the coefficients of the basis.
fn constraints(basis: &[[f64; 9]; 4]) -> [Cubic; 10] {
    let e = |r: usize, c: usize| -> Linear { std::array::from_fn(|k| basis[k][3 * r + c]) };
    let mut rows = [[0.0; 20]; 10];

    let mut product = [[[0.0; 10]; 3]; 3];
    for i in 0..3 {
        for j in i..3 {
            for k in 0..3 {
                linear_product(&e(i, k), &e(j, k), 1.0, &mut product[i][j]);
            }
            product[j][i] = product[i][j];
        }
    }
    for k in 0..10 {
        let half_trace = 0.5 * (product[0][0][k] + product[1][1][k] + product[2][2][k]);
        for i in 0..3 {
            product[i][i][k] -= half_trace;
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                cubic_product(&product[i][k], &e(k, j), &mut rows[3 * i + j]);
            }
        }
    }
    for c in 0..3 {
        let mut minor = [0.0; 10];
        linear_product(&e(0, (c + 1) % 3), &e(1, (c + 2) % 3), 1.0, &mut minor);
        linear_product(&e(0, (c + 2) % 3), &e(1, (c + 1) % 3), -1.0, &mut minor);
        cubic_product(&minor, &e(2, c), &mut rows[9]);
    }
    rows
}

/// Gauss–Jordan with row pivoting on the first ten columns; returns the last ten columns of rows 4 to 9.
fn eliminate(mut a: [Cubic; 10]) -> Option<[[f64; 10]; 6]> {
    for j in 0..10 {
        let mut pivot = j;
        for i in j + 1..10 {
            if a[i][j].abs() > a[pivot][j].abs() {
                pivot = i;
            }
        }
        // The basis is orthonormal, so that the cubics are of order one; below this there is no unique elimination.
        if a[pivot][j].is_nan() || a[pivot][j].abs() < 1e-14 {
            return None;
        }
        a.swap(j, pivot);
        let row = {
            let inverse = 1.0 / a[j][j];
            for x in &mut a[j][j..] {
                *x *= inverse;
            }
            a[j]
        };
        // Rows 0 to 3 only serve to eliminate: nothing reads them once they are passed.
        for i in (4..10).chain(j + 1..4).filter(|&i| i != j) {
            let factor = a[i][j];
            for k in j..20 {
                a[i][k] -= factor * row[k];
            }
        }
    }
    let mut out = [[0.0; 10]; 6];
    for (k, row) in out.iter_mut().enumerate() {
        row.copy_from_slice(&a[4 + k][10..]);
    }
    Some(out)
}

/// det B(z), lowest power first.
fn determinant(b: &[[[f64; 5]; 3]; 3]) -> [f64; 11] {
    let mut out = [0.0; 11];
    for (r0, r1, r2) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        // The cofactor of the last column of row r0, of degree 6.
        let mut minor = [0.0; 7];
        for i in 0..4 {
            for j in 0..4 {
                minor[i + j] += b[r1][0][i] * b[r2][1][j] - b[r1][1][i] * b[r2][0][j];
            }
        }
        for i in 0..7 {
            for j in 0..5 {
                out[i + j] += minor[i] * b[r0][2][j];
            }
        }
    }
    out
}

/// x and y with B(z) · (x, y, 1) = 0.
fn null_vector(b: &[[[f64; 5]; 3]; 3], z: f64) -> Option<[f64; 2]> {
    let row = |r: usize| -> DVec3 {
        let value = |c: usize| b[r][c].iter().rev().fold(0.0, |sum, &x| sum * z + x);
        let v = DVec3::new(value(0), value(1), value(2));
        v / v.length().max(f64::MIN_POSITIVE)
    };
    let rows = [row(0), row(1), row(2)];
    let crosses = [rows[0].cross(rows[1]), rows[1].cross(rows[2]), rows[2].cross(rows[0])];
    let mut best = crosses[0];
    for c in &crosses[1..] {
        if c.length_squared() > best.length_squared() {
            best = *c;
        }
    }
    let (x, y) = (best.x / best.z, best.y / best.z);
    (x.is_finite() && y.is_finite()).then_some([x, y])
}
