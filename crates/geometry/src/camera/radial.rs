//! SIMPLE_RADIAL (2) and RADIAL (3): polynomial radial distortion on the plane z = 1.

use super::scalar::Scalar;

/// `f, cx, cy, k`.
#[inline(always)]
pub(super) fn simple<T: Scalar>(params: &[T], x: T, y: T) -> [T; 2] {
    let r2 = x * x + y * y;
    let factor = params[0] * (T::constant(1.0) + params[3] * r2);
    [factor * x + params[1], factor * y + params[2]]
}

/// `f, cx, cy, k1, k2`.
#[inline(always)]
pub(super) fn radial<T: Scalar>(params: &[T], x: T, y: T) -> [T; 2] {
    let r2 = x * x + y * y;
    let factor = params[0] * (T::constant(1.0) + r2 * (params[3] + params[4] * r2));
    [factor * x + params[1], factor * y + params[2]]
}
