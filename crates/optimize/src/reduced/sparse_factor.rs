//! A sparse Cholesky factor of any symmetric matrix: one instance of faer's code for all who need one.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::prelude::*;
use faer::sparse::linalg::cholesky::{LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side};
use thiserror::Error;

/// AMD order and symbolic factor of a pattern, and memory for the numbers.
#[derive(Debug)]
pub struct SparseFactor {
    structure: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
}

/// Why a system was not solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SparseError {
    /// The pattern, the factor or its workspace.
    #[error("there is no memory for the sparse factor")]
    OutOfMemory,
    /// A pivot was not positive.
    #[error("the matrix is not positive definite")]
    NotPositiveDefinite,
}

impl SparseFactor {
    /// Analyses the pattern of a lower triangle with the diagonal, `n` × `n`: the rows of column `c`, ascending, are
    /// `rows[column_start[c]..column_start[c + 1]]`.
    ///
    /// # Errors
    /// [`SparseError::OutOfMemory`].
    ///
    /// # Panics
    /// Where the pattern is none.
    pub fn new(n: usize, column_start: Vec<usize>, rows: Vec<usize>) -> Result<Self, SparseError> {
        let structure = SymbolicSparseColMat::<usize>::new_checked(n, n, column_start, None, rows);
        let symbolic =
            factorize_symbolic_cholesky(structure.rb(), Side::Lower, SymmetricOrdering::Amd, Default::default())
                .map_err(|_| SparseError::OutOfMemory)?;
        Ok(Self { structure, symbolic, factor: Vec::new() })
    }

    /// Numbers in the factor.
    pub fn len(&self) -> usize {
        self.symbolic.len_val()
    }

    /// Whether the factor has no numbers.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `n·(nnz/n)²`: the operations of a factorisation, exact where all columns of the factor are equally long, a lower
    /// bound elsewhere.
    pub fn flops(&self) -> f64 {
        (self.len() as f64).powi(2) / self.symbolic.nrows().max(1) as f64
    }

    /// Factorises the matrix with these values, in the order of the pattern, and solves in place for right-hand sides of `n`
    /// numbers each, one after the other.
    ///
    /// # Errors
    /// [`SparseError`]; the right-hand sides are as they were.
    pub fn solve(&mut self, values: &[f64], right: &mut [f64]) -> Result<(), SparseError> {
        let symbolic = &self.symbolic;
        let columns = right.len() / symbolic.nrows().max(1);
        self.factor.clear();
        self.factor.resize(symbolic.len_val(), 0.0);
        let matrix = SparseColMatRef::new(self.structure.rb(), values);
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let scratch = scratch.or(symbolic.solve_in_place_scratch::<f64>(columns, Par::Seq));
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| SparseError::OutOfMemory)?;
        let stack = MemStack::new(&mut memory);
        symbolic
            .factorize_numeric_llt(
                &mut self.factor,
                matrix,
                Side::Lower,
                Default::default(),
                Par::Seq,
                stack,
                Default::default(),
            )
            .map_err(|_| SparseError::NotPositiveDefinite)?;
        let view = MatMut::from_column_major_slice_mut(right, symbolic.nrows(), columns);
        LltRef::new(symbolic, &self.factor).solve_in_place_with_conj(Conj::No, view, Par::Seq, stack);
        Ok(())
    }
}
