//! THIN_PRISM_FISHEYE (10) and RAD_TAN_THIN_PRISM_FISHEYE (11): fisheye lenses whose elements are tilted.

use super::opencv::tangential;
use super::radial::polynomial;
use super::scalar::Scalar;

/// `k1, k2, p1, p2, k3, k4, sx1, sy1` in angle space (source: `algorithms.md` §3.5).
#[inline(always)]
pub(super) fn distort<T: Scalar>(extra: &[T], x: T, y: T) -> [T; 2] {
    let r2 = x * x + y * y;
    let factor = T::constant(1.0) + polynomial(&[extra[0], extra[1], extra[4], extra[5]], r2);
    let tangential = tangential(extra[2], extra[3], x, y, r2);
    [factor * x + tangential[0] + extra[6] * r2, factor * y + tangential[1] + extra[7] * r2]
}

/// `k0..k5, p0, p1, s0..s3`: the radial part first; tangential and prism parts act on its result.
#[inline(always)]
pub(super) fn distort_rad_tan<T: Scalar>(extra: &[T], x: T, y: T) -> [T; 2] {
    let theta2 = x * x + y * y;
    let factor = T::constant(1.0) + polynomial(&extra[..6], theta2);
    let (x, y) = (factor * x, factor * y);
    let r2 = x * x + y * y;
    // This model names its tangential parameters the other way round than OPENCV: p0 goes with x.
    let tangential = tangential(extra[7], extra[6], x, y, r2);
    [x + tangential[0] + polynomial(&extra[8..10], r2), y + tangential[1] + polynomial(&extra[10..12], r2)]
}
