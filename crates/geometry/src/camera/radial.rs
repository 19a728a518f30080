//! SIMPLE_RADIAL (2) and RADIAL (3): polynomial radial distortion; also the polynomial of the fisheye models 5, 8, 9.

use super::scalar::Scalar;

/// Scales a point by `1 + k₁r² + k₂r⁴ + …`, with as many coefficients as given (source: `algorithms.md` §3.5).
/// For fisheye models the point is in angle space, so that `r` is the angle from the axis.
#[inline(always)]
pub(super) fn distort<T: Scalar>(k: &[T], x: T, y: T) -> [T; 2] {
    let r2 = x * x + y * y;
    let factor = T::constant(1.0) + polynomial(k, r2);
    [factor * x, factor * y]
}

/// `k₁s + k₂s² + …` by Horner's rule.
#[inline(always)]
pub(super) fn polynomial<T: Scalar>(k: &[T], s: T) -> T {
    let mut sum = T::constant(0.0);
    for &coefficient in k.iter().rev() {
        sum = (sum + coefficient) * s;
    }
    sum
}
