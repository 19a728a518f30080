//! Pairs without a baseline: the rotation that best carries one set of rays onto the other.

use glam::{DMat3, DQuat};

use super::correspondence::BearingPair;
use super::svd::svd3;

/// The rotation `cam2_from_cam1` that minimises Σ |R r₁ − r₂|²; `None` for fewer than two pairs or parallel rays.
///
/// Source: W. Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976.
pub(super) fn best_rotation<'a>(pairs: impl Iterator<Item = &'a BearingPair>) -> Option<DQuat> {
    let mut moment = DMat3::ZERO;
    for p in pairs {
        let (r1, r2) = (p.first.ray, p.second.ray);
        moment += DMat3::from_cols(r2 * r1.x, r2 * r1.y, r2 * r1.z);
    }
    let (u, s, v) = svd3(&moment)?;
    if s.y <= 1e-12 * s.x {
        return None;
    }
    let mut u = u;
    if (u * v.transpose()).determinant() < 0.0 {
        u.z_axis = -u.z_axis;
    }
    Some(DQuat::from_mat3(&(u * v.transpose())).normalize())
}

/// The squared transfer error of a homography between rays, px²; infinite for a ray sent to the other side.
pub(super) fn transfer_squared(homography: &DMat3, pair: &BearingPair) -> f64 {
    let sent = *homography * pair.first.ray;
    let along = sent.dot(pair.second.ray);
    let [x, y] = pair.second.pixel_by_ray.map(|row| row.dot(sent) / along);
    if along > 0.0 { x * x + y * y } else { f64::INFINITY }
}

/// How much larger the sum of squared errors may get when eight degrees of freedom shrink to three for the pair to
/// count as a rotation. Noise alone adds about 5/(2n): for 15 pairs, a sixth.
const ROTATION_COST_RATIO: f64 = 1.2;

/// Errors below this say nothing, px.
const NUMERICAL_FLOOR_PX: f64 = 1e-3;

/// The rotation, where it explains the pairs as well as the homography between rays does.
pub(super) fn rotation_if_panoramic(pairs: &[&BearingPair], homography: &DMat3) -> Option<DQuat> {
    let rotation = best_rotation(pairs.iter().copied())?;
    let matrix = DMat3::from_quat(rotation);
    let cost = |h: &DMat3| pairs.iter().map(|p| transfer_squared(h, p)).sum::<f64>();
    let floor = pairs.len() as f64 * NUMERICAL_FLOOR_PX * NUMERICAL_FLOOR_PX;
    (cost(&matrix) <= ROTATION_COST_RATIO * (cost(homography) + floor)).then_some(rotation)
}
