//! The bundle adjustment problem as plain data, structure of arrays.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, MAX_PARAMS};
use glam::{DVec2, DVec3};

use super::depth::Depth;
use crate::loss::Loss;

/// What of a pose may move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseFreedom {
    /// Rotation and centre.
    #[default]
    Free,
    /// The centre alone.
    RotationFixed,
    /// Nothing.
    Fixed,
}

/// A Gaussian belief about one camera parameter: adds `½ ((p − mean)/sigma)²` to the cost. Whoever builds it chooses
/// sigma in a unit where a residual of one sigma weighs as much as one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParamPrior {
    /// Index into the camera's parameters.
    pub index: usize,
    /// Believed value.
    pub mean: f64,
    /// Standard deviation, positive.
    pub sigma: f64,
}

/// Minimise `½ Σ ρ(‖project(K, R (X − C)) − x‖²)` over poses, intrinsics and points. Observations are sorted by point.
/// Building one needs no device. The answer is defined up to a similarity where no pose is fixed, or up to a rigid motion
/// with [`Problem::depth`].
#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// Pose of each image; refined.
    pub cam_from_world: Vec<Rigid3>,
    /// Camera of each image, an index into `cameras`; images may share one.
    pub image_camera: Vec<u32>,
    /// What may move, per image.
    pub pose_freedom: Vec<PoseFreedom>,
    /// Intrinsics; refined where `refine_params` says so.
    pub cameras: Vec<Camera>,
    /// Per camera, which parameters may move; entries past the model's parameters are ignored.
    pub refine_params: Vec<[bool; MAX_PARAMS]>,
    /// Per camera, soft priors on parameters that may move.
    pub param_priors: Vec<Vec<ParamPrior>>,
    /// Points in the world; refined. A point observed only once keeps its value.
    pub points: Vec<DVec3>,
    /// All points are constant.
    pub fixed_points: bool,
    /// `points.len() + 1` offsets: observations of point `p` are `track_start[p]..track_start[p + 1]`.
    pub track_start: Vec<u32>,
    /// Image of each observation. An image may see a point more than once.
    pub observation_image: Vec<u32>,
    /// Pixel of each observation.
    pub observation_px: Vec<DVec2>,
    /// Loss of the pixel residual.
    pub loss: Loss,
    /// Metric depth of observations. Spherical cameras have none: their weights must be 0.
    pub depth: Option<Depth>,
}

impl Problem {
    /// Whether all poses and intrinsics are constant, so that every point is a problem of its own.
    pub fn only_points_move(&self) -> bool {
        let poses = self.pose_freedom.iter().any(|&freedom| freedom != PoseFreedom::Fixed);
        let moves = |&c: &u32| {
            let count = self.cameras[c as usize].params.len();
            self.refine_params[c as usize].iter().take(count).any(|&refine| refine)
        };
        !poses && !self.image_camera.iter().any(moves)
    }
}
