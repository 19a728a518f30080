//! What the rows of an observation cost: the pixel and, in a problem with depth, the inverse depth under it.

use epipole_geometry::camera::Real;

use super::PIXELS;
use super::small::Vec3;
use super::structure::Structure;
use crate::bundle::problem::Problem;
use crate::loss::Loss;

/// The losses of both kinds of row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Losses {
    pub(super) pixel: Loss,
    pub(super) depth: Loss,
}

impl Losses {
    pub(super) fn new(problem: &Problem) -> Self {
        Self { pixel: problem.loss, depth: problem.depth.as_ref().map_or(Loss::Squared, |depth| depth.loss) }
    }

    /// Whether weights alone and curvatures are the same thing.
    pub(super) fn is_squared(&self) -> bool {
        self.pixel == Loss::Squared && self.depth == Loss::Squared
    }

    /// What the depth of an observation can cost at most, where its loss is bounded.
    #[inline(always)]
    fn depth_bound(&self, structure: &Structure, o: usize) -> f64 {
        if structure.depth(o)[1] > 0.0 { self.depth.bound().unwrap_or(0.0) } else { 0.0 }
    }

    /// `ρ` of an observation, counted from the bound of its depth: whether the observation is worth more in than out is
    /// then up to its pixel, however wrong its depth. [`Self::offset`] makes the sum whole again.
    #[inline(always)]
    pub(super) fn value<T: Real, const ROWS: usize>(&self, structure: &Structure, o: usize, r: &[T; ROWS]) -> f64 {
        let pixel = self.pixel.value((r[0] * r[0] + r[1] * r[1]).to_f64());
        if ROWS == PIXELS {
            return pixel;
        }
        pixel + (self.depth.value(r[PIXELS].to_f64().powi(2)) - self.depth_bound(structure, o))
    }

    /// `½ Σ` of the bounds that [`Self::value`] leaves out.
    pub(super) fn offset(&self, structure: &Structure) -> f64 {
        self.track_offset(structure, 0..structure.image.len())
    }

    /// [`Self::offset`] of some observations.
    pub(super) fn track_offset(&self, structure: &Structure, track: std::ops::Range<usize>) -> f64 {
        0.5 * track.map(|o| self.depth_bound(structure, o)).sum::<f64>()
    }

    /// The change of [`Self::value`] from residuals `r` to `r + delta`, from the change itself.
    #[inline(always)]
    pub(super) fn difference<T: Real, const ROWS: usize>(&self, r: &[T; ROWS], delta: &[T; ROWS]) -> f64 {
        let two = T::from_f64(2.0);
        let s = (r[0] * r[0] + r[1] * r[1]).to_f64();
        let ds = delta[0] * (two * r[0] + delta[0]) + delta[1] * (two * r[1] + delta[1]);
        let pixel = self.pixel.difference(s, ds.to_f64());
        if ROWS == PIXELS {
            return pixel;
        }
        let (r, delta) = (r[PIXELS].to_f64(), delta[PIXELS].to_f64());
        pixel + self.depth.difference(r * r, delta * (2.0 * r + delta))
    }
}

/// `w (1/z − ρ̂)`; zero without depth.
#[inline(always)]
pub(super) fn depth_residual<T: Real>(z: T, [inverse, weight]: [f64; 2]) -> T {
    if weight == 0.0 { T::ZERO } else { T::from_f64(weight) * (T::ONE / z - T::from_f64(inverse)) }
}

/// The exact change of [`depth_residual`] when `z` changes by `dz`: `−w dz / (z (z + dz))`.
#[inline(always)]
pub(super) fn depth_difference<T: Real>(z: T, dz: T, weight: f64) -> T {
    if weight == 0.0 { T::ZERO } else { -(T::from_f64(weight) * dz) / (z * (z + dz)) }
}

/// The derivative of [`depth_residual`] by the point in the world, given the third row of cam_from_world.
#[inline(always)]
pub(super) fn depth_row<T: Real>(z: T, weight: f64, third_row: Vec3<T>) -> Vec3<T> {
    let by_z = -T::from_f64(weight) / (z * z);
    third_row.map(|v| v * by_z)
}
