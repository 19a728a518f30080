//! The block-Jacobi preconditioner: exact inverses of the diagonal blocks (Schur–Jacobi when taken from the reduced
//! matrix).

use super::layout::BlockLayout;
use super::matrix::BlockMatrix;

/// Inverse diagonal blocks.
#[derive(Clone, Debug)]
pub struct BlockJacobi {
    layout: BlockLayout,
    /// Row-major inverses, one after the other.
    inverse: Vec<f64>,
    start: Vec<usize>,
}

impl BlockJacobi {
    /// From the diagonal of a matrix. A block without a Cholesky factor is replaced by its diagonal.
    pub fn new(matrix: &BlockMatrix) -> Self {
        let layout = matrix.pattern().layout().clone();
        let mut start = vec![0];
        let mut inverse = Vec::new();
        for block in 0..layout.num_blocks() {
            let n = layout.size(block);
            let a: Vec<f64> = (0..n * n).map(|k| matrix.get(block, block, k / n, k % n)).collect();
            inverse.extend(invert_spd(&a, n).unwrap_or_else(|| invert_diagonal(&a, n)));
            start.push(inverse.len());
        }
        Self { layout, inverse, start }
    }

    /// `z = M⁻¹ r`.
    pub fn apply(&self, r: &[f64], z: &mut [f64]) {
        for block in 0..self.layout.num_blocks() {
            let range = self.layout.range(block);
            let rows = self.inverse[self.start[block]..self.start[block + 1]].chunks_exact(range.len().max(1));
            for (k, row) in range.clone().zip(rows) {
                z[k] = row.iter().zip(&r[range.clone()]).map(|(a, b)| a * b).sum();
            }
        }
    }
}

fn invert_diagonal(a: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for k in 0..n {
        let d = a[k * (n + 1)];
        out[k * (n + 1)] = if d > 0.0 { 1.0 / d } else { 1.0 };
    }
    out
}

/// The inverse of a symmetric positive definite matrix (row-major), or `None`.
fn invert_spd(a: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut l = a.to_vec();
    for j in 0..n {
        for k in 0..j {
            l[j * n + j] -= l[j * n + k] * l[j * n + k];
        }
        let pivot = l[j * n + j];
        if pivot <= 0.0 || !pivot.is_finite() {
            return None;
        }
        let root = pivot.sqrt();
        l[j * n + j] = root;
        for i in j + 1..n {
            for k in 0..j {
                l[i * n + j] -= l[i * n + k] * l[j * n + k];
            }
            l[i * n + j] /= root;
        }
    }
    let mut out = vec![0.0; n * n];
    let mut x = vec![0.0; n];
    for column in 0..n {
        for i in 0..n {
            let mut sum = f64::from(u8::from(i == column));
            for k in 0..i {
                sum -= l[i * n + k] * x[k];
            }
            x[i] = sum / l[i * n + i];
        }
        for i in (0..n).rev() {
            let mut sum = x[i];
            for k in i + 1..n {
                sum -= l[k * n + i] * x[k];
            }
            x[i] = sum / l[i * n + i];
        }
        for i in 0..n {
            out[i * n + column] = x[i];
        }
    }
    Some(out)
}
