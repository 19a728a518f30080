//! At which depth an observation counts as in front of its camera, and on which side that is.

use super::projection::Side;
use crate::active::Activation;
use crate::bundle::frustum::Frusta;
use crate::bundle::problem::Problem;

/// The frusta, with how points behind a camera are projected.
#[derive(Clone, Debug)]
pub(super) struct DepthLimits {
    pub(super) side: Side,
    pub(super) frusta: Frusta,
}

impl DepthLimits {
    pub(super) fn new(problem: &Problem, activation: Activation) -> Self {
        let side = if activation == Activation::All { Side::Both } else { Side::Front };
        Self { side, frusta: Frusta::new(problem, activation) }
    }

    #[inline(always)]
    pub(super) fn least(&self, image: usize) -> Option<f64> {
        self.frusta.least_depth(image)
    }
}
