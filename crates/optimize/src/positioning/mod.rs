//! Global positioning: all camera centres and points at once, from rays of known direction.
//!
//! [`solve`] needs no initial positions and no random numbers. A convex problem unfolds the graph, then variable
//! projection minimises GLOMAP's residual with every scale eliminated in closed form. Where the result looks failed, a
//! second convex start (LUD) and the removal of the worst observations are tried.
//! (`reference/solver.md` §3, `reference/global-positioning.md`.)

mod backend;
mod block;
mod convex;
mod cpu;
mod gauge;
#[cfg(feature = "gpu")]
pub mod gpu;
mod layout;
mod normal;
mod options;
mod problem;
mod quality;
mod report;
mod solve;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests;
mod triangle;
mod vec3;

pub use convex::ConvexReport;
pub use normal::LinearSolver;
pub use options::Options;
pub use problem::{PIN_SIGMA, Problem};
pub use quality::{Grade, Quality};
pub use report::{Attempt, Report, Start, Warning};
pub use solve::{solve, solve_async, solve_with};
