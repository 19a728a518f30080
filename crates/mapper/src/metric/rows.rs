//! Depths as the two solvers want them: pinned rays for positioning, inverse-depth rows for bundle adjustment.

use epipole_geometry::camera::{Camera, CameraFamily};
use epipole_optimize::Loss;
use epipole_optimize::bundle::Depth;
use epipole_scene::{KeypointDepth, Observation, Reconstruction};
use glam::DVec3;

use super::options::DepthWeight;
use super::{Metric, depth_of};

/// The paper's weight of an inverse depth in 1/m, against pixels (algorithms.md §1.8).
const PAPER_WEIGHT: f64 = 0.1;
/// What its code puts in place of a missing depth, and adds to every depth, m.
const PAPER_FAR_M: f64 = 1e8;
const PAPER_EPSILON_M: f64 = 1e-6;

/// The length of a keypoint's unit ray, m: `ẑ` over the ray's third coordinate, which is `ẑ ‖(x̂, ŷ, 1)‖` (solver.md §3.1).
/// `None` where the ray does not point forward.
pub(crate) fn ray_length_m(camera: &Camera, ray_in_cam: DVec3, depth: KeypointDepth) -> Option<f64> {
    let forward = camera.model.family() != CameraFamily::Spherical && ray_in_cam.z > 0.0;
    forward.then(|| depth.z_m / ray_in_cam.z).filter(|length| length.is_finite())
}

impl Metric {
    /// The inverse-depth rows of bundle adjustment for observations in the problem's order; `None` where it sees no depth.
    pub(crate) fn rows(
        &self,
        reconstruction: &Reconstruction,
        observations: impl Iterator<Item = Observation>,
    ) -> Option<Depth> {
        if !self.adjusts() {
            return None;
        }
        let observations: Vec<Observation> = observations.collect();
        let mut rows = Depth::unknown(observations.len());
        for (k, &o) in observations.iter().enumerate() {
            let depth = depth_of(reconstruction, o);
            match self.options.weight {
                DepthWeight::Uncertainty => {
                    let Some(depth) = depth else { continue };
                    let Some(z_m) = self.maps[o.image as usize].depth_m(depth.z_m) else { continue };
                    rows.set(k, z_m, depth.relative_sigma);
                }
                DepthWeight::Paper => {
                    rows.inverse[k] = 1.0 / (depth.map_or(PAPER_FAR_M, |d| d.z_m) + PAPER_EPSILON_M);
                    rows.weight[k] = PAPER_WEIGHT;
                }
            }
        }
        if self.options.weight == DepthWeight::Paper {
            rows.loss = Loss::Huber(1.0);
        }
        Some(rows)
    }
}
