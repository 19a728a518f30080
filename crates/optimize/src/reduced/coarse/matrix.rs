//! `A = Zᵀ S Z` without forming `S`, and its inverse.

use faer::prelude::*;
use faer::{Mat, Side};

use super::modes::Basis;
use crate::parallel;
use crate::reduced::{BlockLayout, Incidence};

/// Pieces of points that are summed apart: fixed, so that the sum does not depend on the number of threads.
const PIECES: usize = 8;
/// How often a shift is multiplied by ten before the second level is given up.
const MAX_SHIFTS: usize = 8;

/// A dense symmetric matrix under construction; the lower triangle counts, by blocks of columns.
#[derive(Clone, Debug)]
pub(crate) struct CoarseMatrix {
    dim: usize,
    /// Row-major.
    values: Vec<f64>,
}

/// `Eᵀ Z` of one point for the columns from `first`.
struct Part {
    first: usize,
    count: usize,
    /// 3 × count, row-major.
    values: Vec<f64>,
}

impl CoarseMatrix {
    pub(crate) fn zeros(dim: usize) -> Self {
        Self { dim, values: vec![0.0; dim * dim] }
    }

    /// `A += Zᵀ B Z` for a dense symmetric `B` of the unknowns of `rows`: for each, its block in the basis and its place
    /// in the block.
    pub(crate) fn add_projected(&mut self, basis: &Basis, rows: &[(usize, usize)], block: &[f64]) {
        let size = rows.len();
        let mut columns: Vec<(usize, Vec<f64>)> = Vec::new();
        for (local, &(of_block, row)) in rows.iter().enumerate() {
            for part in &basis.of_block[of_block] {
                for k in 0..part.count {
                    let column = part.first + k;
                    let at = columns.iter().position(|c| c.0 == column).unwrap_or_else(|| {
                        columns.push((column, vec![0.0; size]));
                        columns.len() - 1
                    });
                    columns[at].1[local] += part.values[row * part.count + k];
                }
            }
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        for (a, z_a) in &columns {
            let product: Vec<f64> = (0..size).map(|i| dot(&block[i * size..(i + 1) * size], z_a)).collect();
            for (b, z_b) in columns.iter().filter(|c| c.0 <= *a) {
                self.values[a * self.dim + b] += dot(&product, z_b);
            }
        }
    }

    /// `A += Zᵀ diag(d) Z`.
    pub(crate) fn add_diagonal(&mut self, basis: &Basis, layout: &BlockLayout, diagonal: &[f64]) {
        for block in 0..layout.num_blocks() {
            for (row, &d) in diagonal[layout.range(block)].iter().enumerate() {
                for a in &basis.of_block[block] {
                    for b in &basis.of_block[block] {
                        for k in 0..a.count {
                            for l in 0..b.count {
                                let (x, y) = (a.values[row * a.count + k], b.values[row * b.count + l]);
                                if b.first + l <= a.first + k {
                                    self.values[(a.first + k) * self.dim + b.first + l] += d * x * y;
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    /// `A −= Σ_points (Eᵀ Z)ᵀ (Eᵀ Z)`; `fill` as in [`crate::reduced::BlockMatrix::subtract_points`].
    pub(crate) fn subtract_points(
        &mut self,
        basis: &Basis,
        layout: &BlockLayout,
        incidence: &Incidence,
        fill: impl Fn(usize, &mut [f64]) + Sync + Send,
    ) {
        let (count, dim, pitch) = (incidence.num_points(), self.dim, layout.factor_stride());
        let pieces = parallel::map_indices(PIECES, |piece| {
            let mut sum = vec![0.0; dim * dim];
            let mut factors = Vec::new();
            let mut parts: Vec<Part> = Vec::new();
            for point in piece * count / PIECES..(piece + 1) * count / PIECES {
                let blocks = incidence.blocks(point);
                factors.clear();
                factors.resize(blocks.len() * 3 * pitch, 0.0);
                fill(point, &mut factors);
                parts.clear();
                for (&block, factor) in blocks.iter().zip(factors.chunks_exact(3 * pitch)) {
                    add_participant(basis, block as usize, layout.size(block as usize), pitch, factor, &mut parts);
                }
                for a in &parts {
                    for b in parts.iter().filter(|b| b.first <= a.first) {
                        add_product(&mut sum, dim, a, b);
                    }
                }
            }
            sum
        });
        for piece in pieces {
            self.values.iter_mut().zip(piece).for_each(|(a, b)| *a -= b);
        }
    }

    /// The inverse, row-major, with a relative shift of the diagonal; see [`invert`].
    pub(crate) fn inverse(mut self, shift: f64) -> Option<Vec<f64>> {
        for i in 0..self.dim {
            for j in 0..i {
                self.values[j * self.dim + i] = self.values[i * self.dim + j];
            }
        }
        invert(self.values, self.dim, shift)
    }
}

fn add_participant(basis: &Basis, block: usize, size: usize, pitch: usize, factor: &[f64], parts: &mut Vec<Part>) {
    for columns in &basis.of_block[block] {
        let at = parts.iter().position(|part| part.first == columns.first).unwrap_or_else(|| {
            let (first, count) = (columns.first, columns.count);
            parts.push(Part { first, count, values: vec![0.0; 3 * count] });
            parts.len() - 1
        });
        let part = &mut parts[at];
        for (line, out) in factor.chunks_exact(pitch).zip(part.values.chunks_exact_mut(columns.count)) {
            for (e, row) in line[..size].iter().zip(columns.values.chunks_exact(columns.count)) {
                out.iter_mut().zip(row).for_each(|(out, z)| *out += e * z);
            }
        }
    }
}

fn add_product(sum: &mut [f64], dim: usize, a: &Part, b: &Part) {
    for k in 0..a.count {
        let x: [f64; 3] = std::array::from_fn(|c| a.values[c * a.count + k]);
        let out = &mut sum[(a.first + k) * dim + b.first..][..b.count];
        for (l, out) in out.iter_mut().enumerate() {
            *out += x[0] * b.values[l] + x[1] * b.values[b.count + l] + x[2] * b.values[2 * b.count + l];
        }
    }
}

/// The inverse of a symmetric matrix (row-major, full) whose diagonal is raised by a share of itself, ten times as much
/// as long as there is no Cholesky factor. Columns without any content become 0. `None` where nothing helps.
pub(crate) fn invert(mut values: Vec<f64>, dim: usize, shift: f64) -> Option<Vec<f64>> {
    let scale: Vec<f64> = (0..dim)
        .map(|i| {
            let d = values[i * dim + i];
            if d > 0.0 && d.is_finite() { 1.0 / d.sqrt() } else { 0.0 }
        })
        .collect();
    for i in 0..dim {
        for j in 0..dim {
            values[i * dim + j] *= scale[i] * scale[j];
        }
    }
    if values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let mut shift = shift;
    for _ in 0..MAX_SHIFTS {
        let shifted = Mat::<f64>::from_fn(dim, dim, |i, j| match (i == j, scale[i] > 0.0) {
            (true, true) => 1.0 + shift,
            (true, false) => 1.0,
            _ => values[i * dim + j],
        });
        if let Ok(factor) = shifted.llt(Side::Lower) {
            let inverse = factor.solve(Mat::<f64>::identity(dim, dim));
            let symmetric = |i: usize, j: usize| 0.5 * scale[i] * scale[j] * (inverse[(i, j)] + inverse[(j, i)]);
            return Some((0..dim * dim).map(|k| symmetric(k / dim, k % dim)).collect());
        }
        shift *= 10.0;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverts_what_is_definite_shifts_what_is_not_and_drops_empty_columns() {
        let a = vec![4.0, 1.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 0.0];
        let inverse = invert(a, 3, 0.0).expect("positive definite");
        let wanted = [3.0 / 11.0, -1.0 / 11.0, 0.0, -1.0 / 11.0, 4.0 / 11.0, 0.0, 0.0, 0.0, 0.0];
        assert!(inverse.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-15), "{inverse:?}");
        // Eigenvalue −2e-4 after scaling: shifts up to 1e-4 do not help, 1e-3 does.
        let c = 1.0002;
        let inverse = invert(vec![100.0, 10.0 * c, 10.0 * c, 1.0], 2, 1e-6).expect("a shift helps");
        let determinant = 1.001f64.powi(2) - c * c;
        assert!((inverse[0] - 1.001 / (100.0 * determinant)).abs() < 1e-6, "{inverse:?}");
        assert_eq!(invert(vec![1.0, 1e9, 1e9, 1.0], 2, 1e-10), None);
        assert_eq!(invert(vec![1.0, f64::NAN, f64::NAN, 1.0], 2, 1e-10), None);
    }
}
