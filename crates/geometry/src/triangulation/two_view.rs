//! A point from two views.

use glam::{DVec3, DVec4};

use super::View;
use super::eigen::smallest_eigenvector;
use crate::Rigid3;

/// The midpoint of the shortest segment between two rays; `None` if they are parallel. The point may lie behind.
pub fn triangulate_midpoint(first: &View, second: &View) -> Option<DVec3> {
    let (a, b) = (first.ray_in_world, second.ray_in_world);
    let baseline = second.center - first.center;
    let cosine = a.dot(b);
    // sin² by the cross product: 1 − cos² would lose the small angles.
    let sine2 = a.cross(b).length_squared();
    let along_first = (baseline.dot(a) - cosine * baseline.dot(b)) / sine2;
    let along_second = (cosine * baseline.dot(a) - baseline.dot(b)) / sine2;
    let midpoint = 0.5 * ((first.center + along_first * a) + (second.center + along_second * b));
    // Below this the angle is lost in the rounding of the bearings themselves.
    let measurable = sine2 > f64::EPSILON * f64::EPSILON;
    (measurable && midpoint.is_finite()).then_some(midpoint)
}

/// The homogeneous linear solution of `x × (P X) = 0` in both views (source: Hartley and Zisserman §12.2), for bearings
/// in the camera frames; `None` if the point is at infinity. The point may lie behind.
pub fn triangulate_two_view_dlt(
    cam1_from_world: &Rigid3,
    cam2_from_world: &Rigid3,
    ray_in_cam1: DVec3,
    ray_in_cam2: DVec3,
) -> Option<DVec3> {
    let mut normal = [[0.0; 4]; 4];
    for (pose, ray) in [(cam1_from_world, ray_in_cam1), (cam2_from_world, ray_in_cam2)] {
        let rotation = pose.rotation_matrix();
        let row = |i: usize| rotation.row(i).extend(pose.translation[i]);
        let equations: [DVec4; 2] = [ray.x * row(2) - ray.z * row(0), ray.y * row(2) - ray.z * row(1)];
        for e in equations {
            for i in 0..4 {
                for j in 0..=i {
                    normal[i][j] += e[i] * e[j];
                }
            }
        }
    }
    let [x, y, z, w] = smallest_eigenvector(normal)?;
    let position = DVec3::new(x, y, z) / w;
    position.is_finite().then_some(position)
}
