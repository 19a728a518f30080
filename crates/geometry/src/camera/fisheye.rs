//! The map all fisheye models (5, 8–11, 14, 15) start with: from the plane z = 1 to angles from the optical axis.

use glam::DVec2;

use super::scalar::Scalar;

/// Keeps radii away from zero, where a square root has no derivative and a ratio no value. Its root, 1e-15, is below
/// the resolution of any image, and it is a normal number in `f32` too.
pub(super) const TINY: f64 = 1e-30;

/// `(x, y)·θ/r` with `θ = atan r` (source: `algorithms.md` §3.5). The ratio needs no series near the axis: its rounding
/// error is relative to 1, also in derivatives and differences once they are multiplied by x and y.
#[inline(always)]
pub(super) fn angles_from_plane<T: Scalar>(x: T, y: T) -> [T; 2] {
    let r = (x * x + y * y + T::constant(TINY)).sqrt();
    let ratio = r.atan2(T::constant(1.0)) / r;
    [ratio * x, ratio * y]
}

/// The inverse of [`angles_from_plane`]; `None` for 90° and more, which COLMAP's fisheye models cannot see.
pub(super) fn plane_from_angles(angles: DVec2) -> Option<DVec2> {
    let theta = (angles.length_squared() + TINY).sqrt();
    (theta < std::f64::consts::FRAC_PI_2).then(|| angles * (theta.tan() / theta))
}
