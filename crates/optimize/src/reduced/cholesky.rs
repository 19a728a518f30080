//! Solving the reduced system exactly: dense or sparse Cholesky, whichever suits its pattern.

use std::sync::Arc;

use super::dense::DenseCholesky;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use super::sparse::SparseCholesky;
use crate::error::OptimizeError;
use crate::lm::Observer;

/// Share of stored blocks above which a dense factor is faster (source: `scale.md` §5).
const DENSE_DENSITY: f64 = 0.35;
/// Below this many blocks a dense factor is always fast enough (source: `scale.md` §5).
const DENSE_BLOCKS: usize = 60;

/// The matrix has no Cholesky factor: the damping is too small, or a value is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotPositiveDefinite;

/// Which factor is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CholeskyKind {
    /// All of the triangle.
    Dense,
    /// Fill-reducing order (AMD), supernodal.
    Sparse,
}

/// A solver for matrices of one pattern. The symbolic factor and the memory are kept from one solve to the next.
#[derive(Debug)]
pub struct Cholesky(Inner);

#[derive(Debug)]
enum Inner {
    Dense(DenseCholesky),
    Sparse(Box<SparseCholesky>),
}

impl Cholesky {
    /// Chooses the factor, and orders and analyses the pattern where it is sparse.
    pub fn new(pattern: &Arc<BlockPattern>) -> Result<Self, OptimizeError> {
        if pattern.density() > DENSE_DENSITY || pattern.layout().num_blocks() < DENSE_BLOCKS {
            Ok(Self(Inner::Dense(DenseCholesky::new(pattern))))
        } else {
            Ok(Self(Inner::Sparse(Box::new(SparseCholesky::new(pattern)?))))
        }
    }

    /// Dense or sparse.
    pub fn kind(&self) -> CholeskyKind {
        match self.0 {
            Inner::Dense(_) => CholeskyKind::Dense,
            Inner::Sparse(_) => CholeskyKind::Sparse,
        }
    }

    /// Estimated multiply-adds of one factorisation.
    pub fn flops(&self) -> f64 {
        match &self.0 {
            Inner::Dense(dense) => dense.flops(),
            Inner::Sparse(sparse) => sparse.flops(),
        }
    }

    /// `x` with `A x = rhs`. The matrix must have the pattern given to [`Self::new`].
    pub async fn solve(
        &mut self,
        matrix: &BlockMatrix,
        rhs: &[f64],
        observer: &mut dyn Observer,
    ) -> Result<Vec<f64>, NotPositiveDefinite> {
        let x = match &mut self.0 {
            Inner::Dense(dense) => dense.solve(matrix, rhs, observer).await?,
            Inner::Sparse(sparse) => sparse.solve(matrix, rhs)?,
        };
        if x.iter().all(|v| v.is_finite()) { Ok(x) } else { Err(NotPositiveDefinite) }
    }
}
