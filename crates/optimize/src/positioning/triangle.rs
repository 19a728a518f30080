//! The 3×3 block of a point, kept as a triangle: half the digits are lost in `JᵀJ`, none in `R`.

use epipole_geometry::camera::Real;

use super::vec3::{Vec3, zero};

/// A diagonal entry below this part of the trace is damped as if it were this large: a direction in which the rays
/// carry a millionth of the information (0.06° of parallax along a world axis) is left where it is.
const DIAGONAL_FLOOR: f64 = 1e-6;

/// Upper triangle `R` (r00 r01 r02 r11 r12 r22) with `RᵀR = Σ JᵀJ` over the rows folded in (streaming Givens QR,
/// `reference/solver.md` §1.3 b).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Triangle<T>(pub(crate) [T; 6]);

impl<T: Real> Triangle<T> {
    /// No rows yet.
    pub(crate) fn zero() -> Self {
        Self([T::ZERO; 6])
    }

    /// Adds one row of `J` by three rotations.
    #[inline]
    pub(crate) fn fold(&mut self, row: Vec3<T>) {
        let [r00, r01, r02, r11, r12, r22] = &mut self.0;
        let [mut a, mut b, mut c] = row;
        if a != T::ZERO {
            let h = (*r00 * *r00 + a * a).sqrt();
            let (cos, sin) = (*r00 / h, a / h);
            *r00 = h;
            (*r01, b) = (cos * *r01 + sin * b, cos * b - sin * *r01);
            (*r02, c) = (cos * *r02 + sin * c, cos * c - sin * *r02);
            a = T::ZERO;
        }
        if b != T::ZERO {
            let h = (*r11 * *r11 + b * b).sqrt();
            let (cos, sin) = (*r11 / h, b / h);
            *r11 = h;
            (*r12, c) = (cos * *r12 + sin * c, cos * c - sin * *r12);
        }
        if c != T::ZERO {
            *r22 = (*r22 * *r22 + c * c).sqrt();
        }
        let _ = a;
    }

    /// Diagonal of `RᵀR`, each entry at least [`DIAGONAL_FLOOR`] of the trace: what Marquardt's damping multiplies.
    #[inline]
    pub(crate) fn damping_diagonal(&self) -> Vec3<T> {
        let [r00, r01, r02, r11, r12, r22] = self.0;
        floored([r00 * r00, r01 * r01 + r11 * r11, r02 * r02 + r12 * r12 + r22 * r22])
    }

    /// The triangle of `RᵀR + λ diag(RᵀR)`.
    #[inline]
    pub(crate) fn damped(&self, lambda: T) -> Self {
        let [d0, d1, d2] = self.damping_diagonal();
        let mut damped = *self;
        damped.fold([(lambda * d0).sqrt(), T::ZERO, T::ZERO]);
        damped.fold([T::ZERO, (lambda * d1).sqrt(), T::ZERO]);
        damped.fold([T::ZERO, T::ZERO, (lambda * d2).sqrt()]);
        damped
    }

    /// `R⁻¹`, upper; all zero when `R` is singular, which freezes the point.
    #[inline]
    pub(crate) fn inverse(&self) -> Self {
        let [r00, r01, r02, r11, r12, r22] = self.0;
        let product = r00 * r11 * r22;
        // The diagonal is never negative; NaN is not finite.
        if product == T::ZERO || !product.is_finite() {
            return Self::zero();
        }
        let (i00, i11, i22) = (T::ONE / r00, T::ONE / r11, T::ONE / r22);
        let i01 = -(i00 * r01 * i11);
        let i12 = -(i11 * r12 * i22);
        let i02 = -(i00 * (r01 * i12 + r02 * i22));
        Self([i00, i01, i02, i11, i12, i22])
    }

    /// `R v`.
    #[inline(always)]
    pub(crate) fn apply(&self, v: Vec3<T>) -> Vec3<T> {
        let [r00, r01, r02, r11, r12, r22] = self.0;
        [r00 * v[0] + r01 * v[1] + r02 * v[2], r11 * v[1] + r12 * v[2], r22 * v[2]]
    }

    /// `Rᵀ v`.
    #[inline(always)]
    pub(crate) fn apply_transpose(&self, v: Vec3<T>) -> Vec3<T> {
        let [r00, r01, r02, r11, r12, r22] = self.0;
        [r00 * v[0], r01 * v[0] + r11 * v[1], r02 * v[0] + r12 * v[1] + r22 * v[2]]
    }
}

/// Each entry at least [`DIAGONAL_FLOOR`] of the sum.
#[inline]
pub(crate) fn floored<T: Real>(diagonal: Vec3<T>) -> Vec3<T> {
    let floor = T::from_f64(DIAGONAL_FLOOR) * (diagonal[0] + diagonal[1] + diagonal[2]);
    [diagonal[0].max(floor), diagonal[1].max(floor), diagonal[2].max(floor)]
}

/// Two unit vectors that make an orthonormal basis with the unit vector `n` (Duff et al., JCGT 2017).
#[inline]
pub(crate) fn orthonormal_basis<T: Real>(n: Vec3<T>) -> [Vec3<T>; 2] {
    let sign = if n[2] < T::ZERO { -T::ONE } else { T::ONE };
    let a = -(T::ONE / (sign + n[2]));
    let b = n[0] * n[1] * a;
    [[T::ONE + sign * n[0] * n[0] * a, sign * b, -(sign * n[0])], [b, sign + n[1] * n[1] * a, -n[1]]]
}

/// Folds the rows of `scale · (I − direction directionᵀ)`: two in the plane across `direction`, or three when
/// `direction` is zero.
#[inline]
pub(crate) fn fold_projector<T: Real>(triangle: &mut Triangle<T>, scale: T, direction: Vec3<T>) {
    if scale == T::ZERO {
        return;
    }
    if direction == zero() {
        triangle.fold([scale, T::ZERO, T::ZERO]);
        triangle.fold([T::ZERO, scale, T::ZERO]);
        triangle.fold([T::ZERO, T::ZERO, scale]);
    } else {
        for row in orthonormal_basis(direction) {
            triangle.fold([scale * row[0], scale * row[1], scale * row[2]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `RᵀR` entries (00, 01, 02, 11, 12, 22).
    fn gram(t: &Triangle<f64>) -> [f64; 6] {
        let [a, b, c, d, e, f] = t.0;
        [a * a, a * b, a * c, b * b + d * d, b * c + d * e, c * c + e * e + f * f]
    }

    #[test]
    fn the_triangle_is_the_root_of_the_normal_matrix() {
        let mut triangle = Triangle::zero();
        let mut expected = [0.0; 6];
        for (scale, direction) in [(2.0, [0.6, 0.0, 0.8]), (0.5, [0.0, -0.6, -0.8]), (1.5, [0.0; 3])] {
            fold_projector(&mut triangle, scale, direction);
            let mut k = 0;
            for row in 0..3 {
                for column in row..3 {
                    let identity = if row == column { 1.0 } else { 0.0 };
                    expected[k] += scale * scale * (identity - direction[row] * direction[column]);
                    k += 1;
                }
            }
        }
        for (got, expected) in gram(&triangle).iter().zip(expected) {
            assert!((got - expected).abs() < 1e-14, "{got} {expected}");
        }
        let v = [0.3, -1.2, 0.7];
        let back = triangle.inverse().apply(triangle.apply(v));
        assert!((0..3).all(|k| (back[k] - v[k]).abs() < 1e-14));
    }

    #[test]
    fn damping_adds_to_the_diagonal_alone() {
        let mut triangle = Triangle::zero();
        fold_projector(&mut triangle, 2.0, [0.6, 0.0, 0.8]);
        fold_projector(&mut triangle, 1.0, [0.0, 0.6, 0.8]);
        let (before, after) = (gram(&triangle), gram(&triangle.damped(0.01)));
        for (k, on_diagonal) in [true, false, false, true, false, true].into_iter().enumerate() {
            let expected = if on_diagonal { 1.01 * before[k] } else { before[k] };
            assert!((after[k] - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn a_point_without_rows_is_frozen() {
        assert_eq!(Triangle::<f64>::zero().damped(1e-4).inverse(), Triangle::zero());
    }
}
