//! SIMPLE_PINHOLE (0) and PINHOLE (1): no distortion.

use super::scalar::Scalar;

/// `f, cx, cy`.
#[inline(always)]
pub(super) fn simple<T: Scalar>(params: &[T], x: T, y: T) -> [T; 2] {
    [params[0] * x + params[1], params[0] * y + params[2]]
}

/// `fx, fy, cx, cy`.
#[inline(always)]
pub(super) fn pinhole<T: Scalar>(params: &[T], x: T, y: T) -> [T; 2] {
    [params[0] * x + params[2], params[1] * y + params[3]]
}
