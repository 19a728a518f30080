//! Rigid motions between two frames. Names carry both frames: `cam_from_world * p_world = p_cam`.

use std::ops::Mul;

use glam::{DMat3, DQuat, DVec3};

/// A rotation followed by a translation: `p_b = rotation · p_a + translation` for a value named `b_from_a`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid3 {
    /// Unit quaternion, `b_from_a`.
    pub rotation: DQuat,
    /// Origin of frame `a` expressed in frame `b`, in the units of `b`.
    pub translation: DVec3,
}

impl Rigid3 {
    /// The motion that leaves every point where it is.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A motion from its parts; the quaternion is normalised.
    pub fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation: rotation.normalize(), translation }
    }

    /// The pose of a camera with the given world-to-camera rotation and centre in the world.
    pub fn from_rotation_and_center(rotation: DQuat, center: DVec3) -> Self {
        Self { rotation, translation: -(rotation * center) }
    }

    /// Where the origin of frame `b` lies in frame `a`: for `cam_from_world`, the camera centre in the world.
    pub fn center(&self) -> DVec3 {
        -(self.rotation.conjugate() * self.translation)
    }

    /// `a_from_b`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// The point in frame `b`.
    pub fn transform_point(&self, point_in_a: DVec3) -> DVec3 {
        self.rotation * point_in_a + self.translation
    }

    /// The rotation as a matrix, `b_from_a`.
    pub fn rotation_matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

impl Mul for Rigid3 {
    type Output = Self;

    /// `c_from_b * b_from_a = c_from_a`.
    fn mul(self, b_from_a: Self) -> Self {
        Self {
            rotation: (self.rotation * b_from_a.rotation).normalize(),
            translation: self.rotation * b_from_a.translation + self.translation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn composition_and_inverse_agree() {
        let b_from_a = Rigid3::new(DQuat::from_xyzw(0.1, -0.2, 0.3, 0.9), DVec3::new(1.0, 2.0, -3.0));
        let c_from_b = Rigid3::new(DQuat::from_xyzw(-0.4, 0.1, 0.2, 0.7), DVec3::new(-0.5, 0.3, 2.0));
        let p = DVec3::new(0.7, -1.1, 4.0);
        let direct = (c_from_b * b_from_a).transform_point(p);
        let chained = c_from_b.transform_point(b_from_a.transform_point(p));
        assert!((direct - chained).length() < 1e-12);
        let back = b_from_a.inverse().transform_point(b_from_a.transform_point(p));
        assert!((back - p).length() < 1e-12);
        assert!(b_from_a.transform_point(b_from_a.center()).length() < 1e-12);
    }
}
