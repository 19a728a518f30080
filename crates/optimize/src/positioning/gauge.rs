//! Positions and the freedom that rays leave them: where the origin is, and how long the unit is.

use epipole_geometry::camera::Real;

use super::layout::{Layout, Rays};
use super::vec3::{Vec3, add, dot, scale, sub, to_dvec3, zero};
use crate::lm::Places;

/// Camera centres and points in the world.
#[derive(Clone, Debug)]
pub(crate) struct Positions<T> {
    /// Per camera.
    pub(crate) centers: Vec<Vec3<T>>,
    /// Per point.
    pub(crate) points: Vec<Vec3<T>>,
}

impl<T: Real> Positions<T> {
    /// By index into the problem's arrays, for whoever draws them.
    pub(crate) fn places(&self, layout: &Layout) -> Places {
        let list = |index: &[u32], positions: &[Vec3<T>]| {
            index.iter().copied().zip(positions.iter().map(|&p| to_dvec3(p))).collect()
        };
        Places {
            centers: list(&layout.image_of_camera, &self.centers),
            points: list(&layout.source_point, &self.points),
        }
    }

    /// Everything in the origin: where the convex starts begin.
    pub(crate) fn origin(layout: &Layout) -> Self {
        Self { centers: vec![zero(); layout.cameras()], points: vec![zero(); layout.points()] }
    }

    /// From the camera to the point of an observation, world frame.
    #[inline(always)]
    pub(crate) fn difference(&self, layout: &Layout, observation: usize) -> Vec3<T> {
        sub(self.points[layout.point[observation] as usize], self.centers[layout.camera[observation] as usize])
    }

    /// Median distance from camera to point.
    pub(crate) fn median_distance(&self, layout: &Layout) -> f64 {
        median(layout.sample().map(|o| {
            let d = self.difference(layout, o);
            dot(d, d).to_f64().sqrt()
        }))
        .unwrap_or(0.0)
    }

    /// Median of the best scales `vᵀd / ‖d‖²` over observations in front of their camera, 1 / world unit.
    pub(crate) fn median_scale(&self, layout: &Layout, rays: &Rays<T>) -> f64 {
        let scales = layout.sample().filter_map(|o| {
            let d = self.difference(layout, o);
            let s = (dot(rays.direction[o], d) / dot(d, d)).to_f64();
            (s > 0.0 && s.is_finite()).then_some(s)
        });
        median(scales).unwrap_or(1.0)
    }

    /// Puts the mean of the centres in the origin and, unless the rays are metric, the median distance to 1. Returns
    /// new lengths per old length.
    pub(crate) fn normalize(&mut self, layout: &Layout, rays: &Rays<T>) -> f64 {
        let mut mean = zero::<f64>();
        for center in &self.centers {
            mean = add(mean, center.map(T::to_f64));
        }
        let mean = scale(mean, 1.0 / self.centers.len().max(1) as f64).map(T::from_f64);
        let distance = self.median_distance(layout);
        let factor = if rays.metric || !(distance > 0.0 && distance.is_finite()) { 1.0 } else { 1.0 / distance };
        let factor_t = T::from_f64(factor);
        for position in self.centers.iter_mut().chain(&mut self.points) {
            *position = scale(sub(*position, mean), factor_t);
        }
        factor
    }

    /// Multiplies all positions.
    pub(crate) fn rescale(&mut self, factor: f64) {
        let factor = T::from_f64(factor);
        self.centers.iter_mut().chain(&mut self.points).for_each(|p| *p = scale(*p, factor));
    }
}

/// The upper median; `None` of nothing.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
