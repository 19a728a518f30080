//! Nonlinear least squares for structure from motion: one Levenberg–Marquardt loop and the problems it solves.
//!
//! Problems are plain data ([`bundle::Problem`]); a system is a problem resident on a device; [`lm::minimize`] drives
//! any system and knows neither devices nor cameras. Points are eliminated; what is left for the cameras is in
//! [`reduced`].

// Unit tests share the scenes of the integration tests, which name this crate from outside.
#[cfg(test)]
extern crate self as epipole_optimize;
#[cfg(all(test, feature = "gpu"))]
#[path = "../tests/common/mod.rs"]
mod common_for_tests;

pub mod active;
pub mod bundle;
pub mod engine;
mod error;
pub mod executor;
mod extraction;
#[cfg(feature = "gpu")]
pub mod gpu;
mod grouping;
pub mod lm;
pub mod loss;
pub(crate) mod parallel;
pub mod positioning;
pub mod reduced;

pub use engine::Engine;
pub use error::OptimizeError;
pub use loss::Loss;
