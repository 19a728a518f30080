//! Dense Cholesky of the reduced matrix, tiled so that it runs on all cores and gives the same bytes on any number.

use std::sync::Arc;

use faer::linalg::cholesky::llt;
use faer::prelude::*;
use faer::{MatMut, Par};

use super::cholesky::NotPositiveDefinite;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;

/// A dense factor and its memory.
#[derive(Debug)]
pub(super) struct DenseCholesky {
    dim: usize,
    /// Column-major; the lower triangle counts.
    factor: Vec<f64>,
}

impl DenseCholesky {
    pub(super) fn new(pattern: &Arc<BlockPattern>) -> Self {
        Self { dim: pattern.layout().dim(), factor: Vec::new() }
    }

    pub(super) fn flops(&self) -> f64 {
        (self.dim as f64).powi(3) / 3.0
    }

    pub(super) fn solve(&mut self, matrix: &BlockMatrix, rhs: &[f64]) -> Result<Vec<f64>, NotPositiveDefinite> {
        let n = self.dim;
        let mut x = rhs.to_vec();
        if n == 0 {
            return Ok(x);
        }
        self.load(matrix);
        let mut view = MatMut::from_column_major_slice_mut(&mut self.factor, n, n);
        let scratch = llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
        let mut memory = faer::dyn_stack::MemBuffer::new(scratch);
        let stack = faer::dyn_stack::MemStack::new(&mut memory);
        llt::factor::cholesky_in_place(view.rb_mut(), Default::default(), Par::Seq, stack, Default::default())
            .map_err(|_| NotPositiveDefinite)?;
        let rhs = MatMut::from_column_major_slice_mut(&mut x, n, 1);
        llt::solve::solve_in_place(view.rb(), rhs, Par::Seq, stack);
        Ok(x)
    }

    /// The stored upper blocks are rows of the upper triangle, hence columns of the lower one.
    fn load(&mut self, matrix: &BlockMatrix) {
        let n = self.dim;
        self.factor.clear();
        self.factor.resize(n * n, 0.0);
        let pattern = matrix.pattern();
        let layout = pattern.layout();
        for i in 0..layout.num_blocks() {
            for slot in pattern.row(i) {
                let columns = layout.range(pattern.column(slot));
                let stride = layout.stride(pattern.column(slot));
                for (k, row) in layout.range(i).enumerate() {
                    let from = pattern.value_offset(slot) + k * stride;
                    self.factor[row * n + columns.start..row * n + columns.end]
                        .copy_from_slice(&matrix.values[from..from + columns.len()]);
                }
            }
        }
    }
}
