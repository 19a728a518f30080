//! Two views: from matched pixels to the relative pose of two cameras.
//!
//! Solvers for minimal samples and for many matches, residuals in pixels, a deterministic LO-RANSAC, decomposition and
//! refinement, and COLMAP's decision between them ([`estimate_two_view`]). Everything is `f64` and pure.
//! Conventions: rays are unit vectors in their camera frame, `ray2ᵀ E ray1 = 0`, `x2ᵀ F x1 = 0` in pixels,
//! `E = [t]× R` for `cam2_from_cam1 = (R, t)`.

mod cheirality;
mod config;
mod correspondence;
mod decompose;
mod eight_point;
mod estimate;
mod estimators;
mod five_point;
mod homography;
mod normalize;
mod null_space;
mod panorama;
mod polynomial;
mod ransac;
mod refine_relative_pose;
mod relative_pose;
mod sampson;
mod seven_point;
mod svd;
mod watermark;

#[cfg(test)]
mod tests;

pub use cheirality::{is_in_front, parallax_rad};
pub use config::TwoViewConfig;
pub use correspondence::LANES;
pub use decompose::{PlaneMotion, decompose_essential, decompose_homography, essential_from_pose};
pub use eight_point::{closest_essential, eight_point_essential, eight_point_fundamental};
pub use estimate::{TwoViewGeometry, TwoViewOptions, estimate_two_view};
pub use five_point::five_point;
pub use homography::{homography_four_point, homography_least_squares};
pub use ransac::{Estimator, RansacOptions, RansacReport, ransac, shuffled};
pub use refine_relative_pose::{RefineOptions, RefinedPose, SampsonLoss, refine_relative_pose};
pub use relative_pose::{
    PoseSource, RelativePose, RelativePoseOptions, calibration_matrix, estimate_relative_pose,
    relative_pose_from_geometry,
};
pub use sampson::{homography_transfer_error_px, sampson_error_px, tangent_sampson_error_px};
pub use seven_point::seven_point;
pub use watermark::{WatermarkOptions, is_watermark};
