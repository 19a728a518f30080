//! Which side of the cameras a correspondence lies on, and under which angle it is seen.

use glam::{DQuat, DVec3};

use crate::Rigid3;

/// Whether the rays of a correspondence meet in front of both cameras: both depths of the closest points positive.
///
/// With `a = −Rr₁·r₂`, `b₁ = −Rr₁·t`, `b₂ = r₂·t`: `b₁ − a b₂ > 0` and `b₂ − a b₁ > 0` (`algorithms.md` §2.2).
/// Rays are of unit length, each in its own camera frame.
#[inline]
pub fn is_in_front(cam2_from_cam1: &Rigid3, ray1: DVec3, ray2: DVec3) -> bool {
    in_front_after_rotation(cam2_from_cam1.rotation * ray1, ray2, cam2_from_cam1.translation)
}

#[inline]
pub(super) fn in_front_after_rotation(rotated_ray1: DVec3, ray2: DVec3, translation: DVec3) -> bool {
    let a = -rotated_ray1.dot(ray2);
    let b1 = -rotated_ray1.dot(translation);
    let b2 = ray2.dot(translation);
    b1 - a * b2 > 0.0 && b2 - a * b1 > 0.0
}

/// [`is_in_front`], but rays that are parallel up to `parallel_rad` and point the same way count as a point at
/// infinity: noise alone decides the sign of such a depth.
#[inline]
pub(super) fn is_in_front_or_far(cam2_from_cam1: &Rigid3, ray1: DVec3, ray2: DVec3, parallel_rad: f64) -> bool {
    let rotated = cam2_from_cam1.rotation * ray1;
    let far = rotated.dot(ray2) > 0.0 && rotated.cross(ray2).length_squared() < parallel_rad * parallel_rad;
    far || in_front_after_rotation(rotated, ray2, cam2_from_cam1.translation)
}

/// The angle under which a correspondence is seen, min(θ, π − θ), rad; only the rotation matters.
pub fn parallax_rad(rotation: DQuat, ray1: DVec3, ray2: DVec3) -> f64 {
    let rotated = rotation * ray1;
    rotated.cross(ray2).length().atan2(rotated.dot(ray2).abs())
}

/// The median of [`parallax_rad`] over pairs of rays, rad; 0 for none.
pub(super) fn median_parallax_rad(rotation: DQuat, pairs: impl Iterator<Item = (DVec3, DVec3)>) -> f64 {
    let mut angles: Vec<f64> = pairs.map(|(r1, r2)| parallax_rad(rotation, r1, r2)).collect();
    if angles.is_empty() {
        return 0.0;
    }
    let middle = angles.len() / 2;
    *angles.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_signs_follow_the_point() {
        let cam2_from_cam1 = Rigid3::new(DQuat::from_rotation_y(0.3), DVec3::new(-1.0, 0.2, 0.1));
        for (z, expected) in [(4.0, true), (-4.0, false)] {
            let point = DVec3::new(0.5, -0.3, z);
            let (ray1, ray2) = (point.normalize(), cam2_from_cam1.transform_point(point).normalize());
            // A point behind is seen along the opposite rays.
            let sign = z.signum();
            assert!(is_in_front(&cam2_from_cam1, ray1, ray2));
            assert_eq!(is_in_front(&cam2_from_cam1, ray1 * sign, ray2 * sign), expected);
            assert!(!is_in_front(&cam2_from_cam1, ray1, -ray2));
        }
    }

    #[test]
    fn parallax_is_the_acute_angle() {
        let ray = |angle: f64| DVec3::new(angle.sin(), 0.0, angle.cos());
        assert!((parallax_rad(DQuat::IDENTITY, ray(0.2), ray(0.5)) - 0.3).abs() < 1e-14);
        assert!((parallax_rad(DQuat::IDENTITY, ray(0.0), ray(3.0)) - (std::f64::consts::PI - 3.0)).abs() < 1e-14);
        let pairs = [0.1, 0.2, 0.7].map(|a| (ray(0.0), ray(a)));
        assert!((median_parallax_rad(DQuat::IDENTITY, pairs.into_iter()) - 0.2).abs() < 1e-14);
    }
}
