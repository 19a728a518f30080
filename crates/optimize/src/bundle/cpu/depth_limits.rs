//! At which depth an observation counts as in front of its camera.

use super::projection::Side;
use super::structure::Structure;
use crate::active::{Activation, MIN_RELATIVE_DEPTH};
use crate::bundle::problem::Problem;

/// The least depth of each image, fixed for a solve so that the objective is one function.
#[derive(Clone, Debug)]
pub(super) struct DepthLimits {
    pub(super) side: Side,
    /// `None` where depth does not matter.
    least: Vec<Option<f64>>,
}

impl DepthLimits {
    /// From the depths at the start: 0 where the set of observations is that of the start, else a share of the median.
    pub(super) fn new(problem: &Problem, structure: &Structure, activation: Activation) -> Self {
        let mut depths = Vec::new();
        let least = (0..structure.num_images()).map(|i| match activation {
            Activation::All => None,
            _ if !structure.has_depth(i) => None,
            Activation::ValidAtStart => Some(0.0),
            Activation::Truncated { .. } => {
                depths.clear();
                let pose = &problem.cam_from_world[i];
                let points = structure.observations_of(i).iter().map(|&o| structure.point[o as usize] as usize);
                depths.extend(points.map(|p| pose.transform_point(problem.points[p]).z).filter(|z| *z > 0.0));
                let middle = depths.len() / 2;
                Some(match depths.is_empty() {
                    true => 0.0,
                    false => MIN_RELATIVE_DEPTH * *depths.select_nth_unstable_by(middle, f64::total_cmp).1,
                })
            }
        });
        let least = least.collect();
        Self { side: if activation == Activation::All { Side::Both } else { Side::Front }, least }
    }

    #[inline(always)]
    pub(super) fn least(&self, image: usize) -> Option<f64> {
        self.least[image]
    }
}
