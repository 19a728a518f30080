//! Sparse Cholesky of the reduced matrix: AMD order and symbolic factor once, numbers many times.

use std::sync::Arc;

use super::cholesky::NotPositiveDefinite;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use super::sparse_factor::SparseFactor;
use crate::error::OptimizeError;

/// A sparse factor of the scalar pattern, and memory for the values.
#[derive(Debug)]
pub(super) struct SparseCholesky {
    factor: SparseFactor,
    values: Vec<f64>,
}

impl SparseCholesky {
    pub(super) fn new(pattern: &Arc<BlockPattern>) -> Result<Self, OptimizeError> {
        let layout = pattern.layout();
        let (mut column_start, mut rows) = (vec![0usize], Vec::new());
        for i in 0..layout.num_blocks() {
            for column in layout.range(i) {
                for slot in pattern.row(i) {
                    rows.extend(layout.range(pattern.column(slot)).filter(|&row| row >= column));
                }
                column_start.push(rows.len());
            }
        }
        let n = layout.dim();
        let factor = SparseFactor::new(n, column_start, rows)
            .map_err(|_| OptimizeError::OutOfMemory { what: "the sparse factor of the camera system" })?;
        Ok(Self { factor, values: Vec::new() })
    }

    /// [`SparseFactor::flops`].
    pub(super) fn flops(&self) -> f64 {
        self.factor.flops()
    }

    pub(super) fn solve(&mut self, matrix: &BlockMatrix, rhs: &[f64]) -> Result<Vec<f64>, NotPositiveDefinite> {
        self.load(matrix);
        let mut x = rhs.to_vec();
        // What has no memory is told from what has no factor by the larger damping that follows: neither gets a step.
        self.factor.solve(&self.values, &mut x).map_err(|_| NotPositiveDefinite)?;
        Ok(x)
    }

    fn load(&mut self, matrix: &BlockMatrix) {
        let pattern = matrix.pattern();
        let layout = pattern.layout();
        self.values.clear();
        for i in 0..layout.num_blocks() {
            for k in 0..layout.size(i) {
                for slot in pattern.row(i) {
                    let j = pattern.column(slot);
                    let from = pattern.value_offset(slot) + k * layout.stride(j);
                    let skip = if j == i { k } else { 0 };
                    self.values.extend_from_slice(&matrix.values[from + skip..from + layout.size(j)]);
                }
            }
        }
    }
}
