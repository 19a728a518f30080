//! Drops the observations and points that the adjusted poses contradict.

use epipole_scene::Reconstruction;
use epipole_scene::filter::{filter_point_pixel, filter_point_triangulation_angle};
use glam::DVec3;

use crate::component::Component;
use crate::parallel;

/// First drops observations that project farther than `max_error_px` from their keypoint, and points that would keep
/// fewer than two; then points that no two of their cameras see under at least `min_angle_deg` (COLMAP's
/// `FilterAllPoints3D`, algorithms.md §2.8). Returns the number of dropped observations; a point that falls for its
/// angle counts with all of its remaining ones.
///
/// The angle of two observations from one place is zero, so with a positive `min_angle_deg` every point that is left is
/// seen from two images.
pub fn filter(component: &mut Component, max_error_px: f64, min_angle_deg: f64) -> usize {
    let Reconstruction { cameras, images, points, .. } = &mut component.reconstruction;
    let min_angle_rad = min_angle_deg.to_radians();
    let centers: Vec<DVec3> = images.iter().map(|image| image.cam_from_world.center()).collect();
    let before: usize = points.iter().map(|point| point.observations.len()).sum();
    parallel::for_each_mut(points, |_, point| {
        filter_point_pixel(cameras, images, max_error_px, point);
        filter_point_triangulation_angle(&centers, min_angle_rad, point);
    });
    points.retain(|point| !point.observations.is_empty());
    before - component.reconstruction.num_observations()
}
