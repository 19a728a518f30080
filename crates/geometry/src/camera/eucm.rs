//! EUCM (16): the enhanced unified camera model of Khomutenko, Garcia and Martinet.

use glam::DVec2;

use super::scalar::Scalar;

/// `alpha, beta`: divides by `α√(βr² + 1) + 1 − α` (source: `algorithms.md` §3.5, divided by the depth);
/// `None` where the root or the denominator is not positive.
#[inline(always)]
pub(super) fn distort<T: Scalar>(extra: &[T], x: T, y: T) -> Option<[T; 2]> {
    let one = T::constant(1.0);
    let (alpha, beta) = (extra[0], extra[1]);
    let square = beta * (x * x + y * y) + one;
    if square.lowest() < 0.0 {
        return None;
    }
    let denominator = alpha * square.sqrt() + one - alpha;
    if denominator.lowest() < f64::EPSILON {
        return None;
    }
    Some([x / denominator, y / denominator])
}

/// The inverse: the depth is `(1 − α²βr²)/(α√(1 − (2α − 1)βr²) + 1 − α)`; `None` where it is not positive.
pub(super) fn undistort(alpha: f64, beta: f64, distorted: DVec2) -> Option<DVec2> {
    let beta_r2 = beta * distorted.length_squared();
    let square = 1.0 - (2.0 * alpha - 1.0) * beta_r2;
    if square < 0.0 {
        return None;
    }
    let depth = (1.0 - alpha * alpha * beta_r2) / (alpha * square.sqrt() + 1.0 - alpha);
    (depth > f64::EPSILON && depth.is_finite()).then(|| distorted / depth)
}
