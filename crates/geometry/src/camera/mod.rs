//! Camera models 0–17 of COLMAP: from a point in the camera frame to a pixel and back.
//!
//! Each family is one file with formulas generic over the scalar; derivatives come from [`Jet`] (by hand for the most
//! frequent models), exact differences of two states from [`Difference`] (source: `algorithms.md` §3.5).

mod derivatives;
mod difference;
mod division;
mod equirectangular;
mod eucm;
mod fisheye;
mod fov;
mod intrinsics;
mod jet;
mod model;
mod opencv;
mod projection;
mod radial;
mod scalar;
mod thin_prism;
mod unprojection;

#[cfg(test)]
mod colmap_pixels;
#[cfg(test)]
mod tests;

pub use difference::Difference;
pub use intrinsics::{Camera, CameraError, DEFAULT_FOCAL_FACTOR};
pub use jet::Jet;
pub use model::{CameraFamily, CameraModel, MAX_PARAMS};
pub use projection::{Projection, project, project_difference, project_with_derivatives};
pub use scalar::{Real, Scalar};
