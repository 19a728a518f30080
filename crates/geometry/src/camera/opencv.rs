//! OPENCV (4) and FULL_OPENCV (6): radial and tangential distortion on the plane z = 1.

use super::radial::polynomial;
use super::scalar::Scalar;

/// `k1, k2, p1, p2` (source: `algorithms.md` §3.5).
#[inline(always)]
pub(super) fn distort<T: Scalar>(extra: &[T], x: T, y: T) -> [T; 2] {
    let r2 = x * x + y * y;
    let factor = T::constant(1.0) + polynomial(&extra[..2], r2);
    let tangential = tangential(extra[2], extra[3], x, y, r2);
    [factor * x + tangential[0], factor * y + tangential[1]]
}

/// `k1, k2, p1, p2, k3, k4, k5, k6`: the radial factor is a fraction of two cubics in r². `None` at its pole and beyond.
#[inline(always)]
pub(super) fn distort_full<T: Scalar>(extra: &[T], x: T, y: T) -> Option<[T; 2]> {
    let one = T::constant(1.0);
    let r2 = x * x + y * y;
    let numerator = one + polynomial(&[extra[0], extra[1], extra[4]], r2);
    let denominator = one + polynomial(&extra[5..8], r2);
    if denominator.lowest() <= 0.0 {
        return None;
    }
    let factor = numerator / denominator;
    let tangential = tangential(extra[2], extra[3], x, y, r2);
    Some([factor * x + tangential[0], factor * y + tangential[1]])
}

/// `2p₁xy + p₂(r² + 2x²)` and `2p₂xy + p₁(r² + 2y²)`.
#[inline(always)]
pub(super) fn tangential<T: Scalar>(p1: T, p2: T, x: T, y: T, r2: T) -> [T; 2] {
    let two = T::constant(2.0);
    let two_xy = two * x * y;
    [p1 * two_xy + p2 * (r2 + two * x * x), p2 * two_xy + p1 * (r2 + two * y * y)]
}
