//! Errors of the relative poses of all pairs of images.

use epipole_geometry::Rigid3;
use glam::{DMat3, DVec3};

/// Errors of pairs, each list in the order of the pairs.
#[derive(Default)]
pub(super) struct PairErrors {
    /// Angle of the rotation between estimated and true relative rotation, degrees.
    pub(super) rotation_deg: Vec<f64>,
    /// Angle between estimated and true translation direction, degrees.
    pub(super) direction_deg: Vec<f64>,
    /// The larger of both, degrees.
    pub(super) combined_deg: Vec<f64>,
}

/// For every pair of images with an estimated and a reference pose.
pub(super) fn relative_pose_errors(poses: &[[Rigid3; 2]], min_baseline: f64) -> PairErrors {
    let parts: Vec<[(DMat3, DVec3); 2]> =
        poses.iter().map(|both| both.map(|p| (p.rotation_matrix(), p.center()))).collect();
    let mut out = PairErrors::default();
    for (i, first) in parts.iter().enumerate() {
        for second in &parts[i + 1..] {
            let relative = |k: usize| second[k].0 * first[k].0.transpose();
            let rotation = rotation_angle_deg(&(relative(0) * relative(1).transpose()));
            // The first centre seen from the second camera: the direction of the relative translation.
            let baseline = |k: usize| second[k].0 * (first[k].1 - second[k].1);
            let direction =
                if baseline(1).length() <= min_baseline { 0.0 } else { angle_deg(baseline(0), baseline(1)) };
            out.rotation_deg.push(rotation);
            out.direction_deg.push(direction);
            out.combined_deg.push(rotation.max(direction));
        }
    }
    out
}

/// The angle of a rotation matrix, degrees; by sine and cosine, as the arc cosine alone loses small angles.
pub(super) fn rotation_angle_deg(rotation: &DMat3) -> f64 {
    let r = rotation;
    let axis = DVec3::new(r.y_axis.z - r.z_axis.y, r.z_axis.x - r.x_axis.z, r.x_axis.y - r.y_axis.x);
    let trace = r.x_axis.x + r.y_axis.y + r.z_axis.z;
    (0.5 * axis.length()).atan2(0.5 * (trace - 1.0)).to_degrees()
}

/// Between two vectors; 90° if one of them is zero, as it says nothing.
fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    let (sine, cosine) = (a.cross(b).length(), a.dot(b));
    if sine == 0.0 && cosine == 0.0 { 90.0 } else { sine.atan2(cosine).to_degrees() }
}
