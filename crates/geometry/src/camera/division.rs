//! SIMPLE_DIVISION (12) and DIVISION (13): Fitzgibbon's one-parameter model, simple from pixel to ray.

use glam::DVec2;

use super::scalar::Scalar;

/// `k`: scales by `2/(1 + √(1 − 4kr²))` (source: `algorithms.md` §3.5, divided by the depth);
/// `None` where the root is negative: such a ray meets no pixel.
#[inline(always)]
pub(super) fn distort<T: Scalar>(extra: &[T], x: T, y: T) -> Option<[T; 2]> {
    let one = T::constant(1.0);
    let square = one - T::constant(4.0) * extra[0] * (x * x + y * y);
    if square.lowest() < 0.0 {
        return None;
    }
    let factor = T::constant(2.0) / (one + square.sqrt());
    Some([factor * x, factor * y])
}

/// The inverse, `(x, y)/(1 + kr²)`; `None` where the denominator is not positive (a ray that does not point forward).
pub(super) fn undistort(k: f64, distorted: DVec2) -> Option<DVec2> {
    let depth = 1.0 + k * distorted.length_squared();
    // Past r² = 1/k (k > 0) the map folds back: those pixels belong to no ray of the forward model.
    let folded = k * distorted.length_squared() > 1.0;
    (depth > f64::EPSILON && !folded).then(|| distorted / depth)
}
