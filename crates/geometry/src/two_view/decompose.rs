//! From an essential matrix or a homography to the motions it allows.

use glam::{DMat3, DQuat, DVec3};

use super::svd::svd3;
use crate::Rigid3;

/// The four motions `cam2_from_cam1` of an essential matrix, with unit baselines; `None` where E is zero, has rank one
/// or is not finite. Source: Hartley and Zisserman, "Multiple View Geometry", 2nd edition, §9.6.2.
pub fn decompose_essential(essential: &DMat3) -> Option<[Rigid3; 4]> {
    let (u, s, v) = svd3(essential)?;
    if s.y <= 1e-12 * s.x {
        return None;
    }
    let quarter_turn = DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z);
    let proper = |m: DMat3| if m.determinant() < 0.0 { m * -1.0 } else { m };
    let (a, b) = (proper(u * quarter_turn * v.transpose()), proper(u * quarter_turn.transpose() * v.transpose()));
    let (a, b) = (DQuat::from_mat3(&a), DQuat::from_mat3(&b));
    let t = u.z_axis;
    Some([Rigid3::new(a, t), Rigid3::new(b, t), Rigid3::new(a, -t), Rigid3::new(b, -t)])
}

/// The essential matrix `[t]× R` of a motion.
pub fn essential_from_pose(cam2_from_cam1: &Rigid3) -> DMat3 {
    cross_matrix(cam2_from_cam1.translation) * cam2_from_cam1.rotation_matrix()
}

/// The matrix of the cross product with `t` from the left.
pub(super) fn cross_matrix(t: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0))
}

/// A motion that a homography between rays allows, and the plane it goes with.
#[derive(Clone, Copy, Debug)]
pub struct PlaneMotion {
    /// The motion; the translation is in units of the distance of the plane from the first camera. Zero where the
    /// homography is a rotation.
    pub cam2_from_cam1: Rigid3,
    /// Unit normal of the plane in the first camera frame.
    pub normal: DVec3,
}

/// How far HᵀH may be from the identity (largest entry) for H to count as a pure rotation; COLMAP's value.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// The motions of a homography between rays, `H ray1 ∝ ray2`: one for a pure rotation, four otherwise (two planes,
/// each with both signs of normal and translation); none where H is singular or not finite.
///
/// Source: Y. Ma, S. Soatto, J. Košecká and S. Sastry, "An Invitation to 3-D Vision", §5.3.3.
pub fn decompose_homography(homography: &DMat3) -> Vec<PlaneMotion> {
    let Some((_, s, v)) = svd3(homography) else { return Vec::new() };
    if s.z <= 1e-12 * s.x {
        return Vec::new();
    }
    let sign = if homography.determinant() < 0.0 { -1.0 } else { 1.0 };
    let h = *homography * (sign / s.y);
    let departure = h.transpose() * h - DMat3::IDENTITY;
    if departure.to_cols_array().iter().all(|x| x.abs() < ROTATION_TOLERANCE) {
        let Some((u, _, v)) = svd3(&h) else { return Vec::new() };
        let rotation = DQuat::from_mat3(&(u * v.transpose()));
        return vec![PlaneMotion { cam2_from_cam1: Rigid3::new(rotation, DVec3::ZERO), normal: DVec3::Z }];
    }
    // Squared singular values, the middle one scaled to 1; directions that H leaves at their length.
    let (large, small) = ((s.x / s.y).powi(2).max(1.0), (s.z / s.y).powi(2).min(1.0));
    let (along_large, along_small) = ((1.0 - small).sqrt(), (large - 1.0).sqrt());
    let scale = 1.0 / (large - small).sqrt();
    let middle = v.y_axis;
    let mut motions = Vec::with_capacity(4);
    for side in [1.0, -1.0] {
        let kept = (v.x_axis * along_large + v.z_axis * (side * along_small)) * scale;
        let normal = middle.cross(kept);
        let before = DMat3::from_cols(middle, kept, normal);
        let (a, b) = (h * middle, h * kept);
        let after = DMat3::from_cols(a, b, a.cross(b));
        let rotation = after * before.transpose();
        let translation = (h - rotation) * normal;
        let rotation = DQuat::from_mat3(&rotation);
        for flip in [1.0, -1.0] {
            let cam2_from_cam1 = Rigid3::new(rotation, translation * flip);
            motions.push(PlaneMotion { cam2_from_cam1, normal: normal * flip });
        }
    }
    motions.retain(|m| m.cam2_from_cam1.is_finite());
    motions
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn motion() -> impl Strategy<Value = Rigid3> {
        (proptest::array::uniform4(-1.0f64..1.0), proptest::array::uniform3(-1.0f64..1.0))
            .prop_filter("not a motion", |(q, t)| {
                q.iter().map(|x| x * x).sum::<f64>() > 0.05 && t.iter().map(|x| x * x).sum::<f64>() > 0.05
            })
            .prop_map(|(q, t)| Rigid3::new(DQuat::from_array(q).normalize(), DVec3::from_array(t)))
    }

    proptest! {
        #[test]
        fn one_of_the_four_motions_is_the_true_one(truth in motion()) {
            let poses = decompose_essential(&essential_from_pose(&truth)).expect("rank two");
            let direction = truth.translation.normalize();
            let best = poses.iter().map(|p| {
                p.rotation.dot(truth.rotation).abs().mul_add(-1.0, 1.0) + (p.translation - direction).length()
            }).fold(f64::INFINITY, f64::min);
            prop_assert!(best < 1e-12, "{best}");
        }

        #[test]
        fn one_of_the_plane_motions_is_the_true_one(truth in motion(), n in proptest::array::uniform3(-1.0f64..1.0)) {
            let normal = DVec3::from_array(n);
            prop_assume!(normal.length() > 0.1);
            let normal = normal.normalize();
            let outer = DMat3::from_cols(
                truth.translation * normal.x, truth.translation * normal.y, truth.translation * normal.z);
            let h = truth.rotation_matrix() + outer;
            // Both cameras must lie on the same side of the plane, and off it.
            prop_assume!(h.determinant() > 0.05);
            let best = decompose_homography(&(h * -3.0)).iter().map(|m| {
                (1.0 - m.cam2_from_cam1.rotation.dot(truth.rotation).abs())
                    + (m.cam2_from_cam1.translation - truth.translation).length() + (m.normal - normal).length()
            }).fold(f64::INFINITY, f64::min);
            prop_assert!(best < 1e-6, "{best}");
        }
    }

    #[test]
    fn a_rotation_has_no_translation() {
        let rotation = DQuat::from_rotation_x(0.4);
        let motions = decompose_homography(&(DMat3::from_quat(rotation) * 7.0));
        assert_eq!(motions.len(), 1);
        assert_eq!(motions[0].cam2_from_cam1.translation, DVec3::ZERO);
        assert!(motions[0].cam2_from_cam1.rotation.angle_between(rotation) < 1e-7);
        assert!(decompose_homography(&DMat3::ZERO).is_empty());
        assert!(decompose_essential(&DMat3::ZERO).is_none());
    }
}
