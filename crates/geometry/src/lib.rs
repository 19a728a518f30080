//! Geometry of images: motions, camera models, two-view and multi-view estimation.
//!
//! Pure functions in `f64` (camera models are generic over the scalar). No input or output, no global state.

pub mod camera;
mod rigid3;
mod similarity3;
pub mod triangulation;
pub mod two_view;

pub use rigid3::Rigid3;
pub use similarity3::Similarity3;
