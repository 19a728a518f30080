//! The system left for the cameras once points are eliminated: symmetric, block-sparse, solved by Cholesky or PCG.
//!
//! Unknowns come in *blocks* (an image's pose, a shared camera's intrinsics, a camera centre). Each eliminated point
//! couples the blocks that see it. How to use it:
//!
//! ```text
//! let layout    = BlockLayout::new(sizes);                    // size of each block; 0 = no unknowns
//! let incidence = Incidence::new(&layout, point_start, block_of_participant)?; // sorted, distinct blocks per point
//! let pattern   = BlockPattern::from_incidence(&layout, &incidence);
//! let mut s     = BlockMatrix::zeros(pattern);
//! // every linearisation and damping:
//! s.fill_zero();
//! s.add_to_block(i, j, &values);          // camera-only normal equations, i <= j, row-major size_i x size_j
//! s.subtract_points(&incidence, |point, factors| …, observer).await;   // S -= sum over points of E Eᵀ
//! s.add_to_diagonal(lambda); s.replace_empty_columns_by_identity();
//! let x = cholesky.solve(&s, &rhs, observer).await?;      // Cholesky::new(&pattern) once: it keeps the symbolic factor
//! ```
//!
//! `E` of a participant (point, block) is `W·R⁻¹` where `W = Σ J_blockᵀ J_point` (size × 3) and `RᵀR` is the damped
//! 3 × 3 normal matrix of the point, so that `E_a E_bᵀ = W_a (RᵀR)⁻¹ W_bᵀ`. The same numbers come out whatever the
//! number of threads: block rows are independent, and each adds its points in ascending order.

mod assemble;
mod cholesky;
pub(crate) mod coarse;
mod dense;
mod incidence;
mod kernel;
mod layout;
mod matrix;
mod pattern;
mod pcg;
mod preconditioner;
mod sparse;
mod sparse_factor;

pub use cholesky::{Cholesky, CholeskyKind, NotPositiveDefinite};
pub use incidence::{Incidence, Member};
pub(crate) use kernel::{Vectorized, dispatch};
pub use layout::BlockLayout;
pub use matrix::BlockMatrix;
pub use pattern::BlockPattern;
pub use pcg::{LinearOperator, PcgOptions, PcgResult, pcg};
pub use preconditioner::BlockJacobi;
pub use sparse_factor::{SparseError, SparseFactor};
