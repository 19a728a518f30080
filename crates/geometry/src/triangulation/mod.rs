//! Points from bearings: two views, many views, and many views with outliers among them.
//!
//! A view is a centre and a bearing in the world frame, so that every camera model and every pose is treated alike.

mod eigen;
mod multi_view;
mod refine;
mod robust;
mod two_view;

use glam::DVec3;

use crate::Rigid3;

pub use multi_view::triangulate_multi_view;
pub use refine::refine_point;
pub use robust::{RobustOptions, Triangulation, estimate_triangulation};
pub use two_view::{triangulate_midpoint, triangulate_two_view_dlt};

/// One observation of a point: where the camera stood and in which direction it saw the point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Camera centre in the world.
    pub center: DVec3,
    /// Unit bearing in the world frame.
    pub ray_in_world: DVec3,
}

impl View {
    /// A view from a pose and a unit bearing in the camera frame.
    pub fn new(cam_from_world: &Rigid3, ray_in_cam: DVec3) -> Self {
        Self { center: cam_from_world.center(), ray_in_world: cam_from_world.rotation.conjugate() * ray_in_cam }
    }

    /// The squared sine of the angle between the bearing and the direction to a point; 1 where the point lies behind
    /// (more than 90° away) or is not finite.
    #[inline]
    pub fn sine_squared(&self, position: DVec3) -> f64 {
        let direction = position - self.center;
        // False for NaN too.
        let in_front = direction.dot(self.ray_in_world) > 0.0;
        if !in_front {
            return 1.0;
        }
        let ratio = self.ray_in_world.cross(direction).length_squared() / direction.length_squared();
        if ratio.is_finite() { ratio } else { 1.0 }
    }

    /// The angle between the bearing and the direction to a point, rad; at most 90°, which stands for "behind".
    pub fn angular_error_rad(&self, position: DVec3) -> f64 {
        self.sine_squared(position).sqrt().min(1.0).asin()
    }
}

/// The angle at a point between the directions to two camera centres, folded to at most 90° (`min(θ, π − θ)`), rad.
/// Zero if the point coincides with a centre (source: `algorithms.md` §2.8).
pub fn triangulation_angle_rad(center1: DVec3, center2: DVec3, position: DVec3) -> f64 {
    let (a, b) = (position - center1, position - center2);
    let angle = a.cross(b).length().atan2(a.dot(b));
    angle.min(std::f64::consts::PI - angle)
}

/// Whether some pair of centres sees the point under at least the given angle. Quadratic in the number of centres at
/// worst, but it ends at the first pair that does.
pub fn has_triangulation_angle<C>(centers: C, position: DVec3, min_angle_rad: f64) -> bool
where
    C: Iterator<Item = DVec3> + Clone,
{
    let mut rest = centers;
    while let Some(first) = rest.next() {
        if rest.clone().any(|second| triangulation_angle_rad(first, second, position) >= min_angle_rad) {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests;
