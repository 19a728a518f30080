//! FOV (7): the field-of-view model of Devernay and Faugeras, one angle ω for a wide lens.

use glam::DVec2;

use super::fisheye::TINY;
use super::scalar::Scalar;

/// `omega`, rad: scales by `atan(2r tan(ω/2))/(rω)` (source: `algorithms.md` §3.5).
///
/// The formula is even in ω and is evaluated at √(ω² + tiny), which needs no series for a small angle or radius.
/// (For ω² < 1e-4 COLMAP uses a series whose signs are those of the inverse function: a difference below 1e-4·r.)
#[inline(always)]
pub(super) fn distort<T: Scalar>(extra: &[T], x: T, y: T) -> [T; 2] {
    let tiny = T::constant(TINY);
    let omega = (extra[0] * extra[0] + tiny).sqrt();
    let r = (x * x + y * y + tiny).sqrt();
    let two_tan = T::constant(2.0) * (omega * T::constant(0.5)).tan();
    let factor = (r * two_tan).atan2(T::constant(1.0)) / (r * omega);
    [factor * x, factor * y]
}

/// The inverse, `r = tan(ω r_d)/(2 tan(ω/2))`; `None` where the tangent has passed its pole.
pub(super) fn undistort(omega_rad: f64, distorted: DVec2) -> Option<DVec2> {
    let omega = (omega_rad * omega_rad + TINY).sqrt();
    let r = (distorted.length_squared() + TINY).sqrt();
    let angle = r * omega;
    (angle < std::f64::consts::FRAC_PI_2).then(|| distorted * (angle.tan() / (2.0 * (0.5 * omega).tan() * r)))
}
