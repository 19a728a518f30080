//! Similarities between two frames, for alignment, normalisation and metric scale.

use glam::{DQuat, DVec3};

use crate::Rigid3;

/// Scale, rotation and translation: `p_b = scale · rotation · p_a + translation` for a value named `b_from_a`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity3 {
    /// Units of `b` per unit of `a`, positive.
    pub scale: f64,
    /// Unit quaternion, `b_from_a`.
    pub rotation: DQuat,
    /// Origin of frame `a` in frame `b`.
    pub translation: DVec3,
}

impl Similarity3 {
    /// The similarity that changes nothing.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// The point in frame `b`.
    pub fn transform_point(&self, point_in_a: DVec3) -> DVec3 {
        self.scale * (self.rotation * point_in_a) + self.translation
    }

    /// `a_from_b`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { scale: 1.0 / self.scale, rotation, translation: -(rotation * self.translation) / self.scale }
    }

    /// The camera pose after the world moved: `self` is `new_from_old`, the argument `cam_from_old`.
    /// The camera keeps its pixels; its distances grow by `scale`.
    pub fn transform_camera(&self, cam_from_old: &Rigid3) -> Rigid3 {
        let rotation = (cam_from_old.rotation * self.rotation.conjugate()).normalize();
        Rigid3::from_rotation_and_center(rotation, self.transform_point(cam_from_old.center()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_and_points_move_together() {
        let new_from_old = Similarity3 {
            scale: 2.5,
            rotation: DQuat::from_xyzw(0.3, 0.1, -0.2, 0.8).normalize(),
            translation: DVec3::new(4.0, -1.0, 0.5),
        };
        let cam_from_old = Rigid3::new(DQuat::from_xyzw(0.1, 0.4, 0.2, 0.9), DVec3::new(0.3, 0.2, 5.0));
        let p = DVec3::new(1.0, 2.0, 3.0);
        let before = cam_from_old.transform_point(p);
        let after = new_from_old.transform_camera(&cam_from_old).transform_point(new_from_old.transform_point(p));
        assert!((after - 2.5 * before).length() < 1e-12);
        assert!((new_from_old.inverse().transform_point(new_from_old.transform_point(p)) - p).length() < 1e-12);
    }
}
