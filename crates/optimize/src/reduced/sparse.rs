//! Sparse Cholesky of the reduced matrix: AMD order and symbolic factor once, numbers many times.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::prelude::*;
use faer::sparse::linalg::cholesky::{LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side};

use super::cholesky::NotPositiveDefinite;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use crate::error::OptimizeError;

/// A sparse factor: the scalar pattern, its symbolic factor, and memory for the numbers.
#[derive(Debug)]
pub(super) struct SparseCholesky {
    structure: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    factor: Vec<f64>,
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
        let structure = SymbolicSparseColMat::<usize>::new_checked(n, n, column_start, None, rows);
        let symbolic =
            factorize_symbolic_cholesky(structure.rb(), Side::Lower, SymmetricOrdering::Amd, Default::default())
                .map_err(|_| OptimizeError::OutOfMemory { what: "the sparse factor of the camera system" })?;
        Ok(Self { structure, symbolic, values: Vec::new(), factor: Vec::new() })
    }

    /// `n·(nnz/n)²`: exact where all columns of the factor are equally long, a lower bound elsewhere.
    pub(super) fn flops(&self) -> f64 {
        let n = self.symbolic.nrows().max(1) as f64;
        (self.symbolic.len_val() as f64).powi(2) / n
    }

    pub(super) fn solve(&mut self, matrix: &BlockMatrix, rhs: &[f64]) -> Result<Vec<f64>, NotPositiveDefinite> {
        self.load(matrix);
        self.factor.clear();
        self.factor.resize(self.symbolic.len_val(), 0.0);
        let a = SparseColMatRef::new(self.structure.rb(), &self.values);
        let scratch = self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let scratch = scratch.or(self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let symbolic = &self.symbolic;
        let regularization = LltRegularization::default();
        symbolic
            .factorize_numeric_llt(
                &mut self.factor,
                a,
                Side::Lower,
                regularization,
                Par::Seq,
                stack,
                Default::default(),
            )
            .map_err(|_| NotPositiveDefinite)?;
        let mut x = rhs.to_vec();
        let view = MatMut::from_column_major_slice_mut(&mut x, rhs.len(), 1);
        LltRef::new(symbolic, &self.factor).solve_in_place_with_conj(Conj::No, view, Par::Seq, stack);
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
