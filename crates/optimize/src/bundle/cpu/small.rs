//! Three-vectors and 3 × 3 matrices in any real scalar, small enough to inline.

use epipole_geometry::camera::Real;

pub(super) type Vec3<T> = [T; 3];
/// Row-major.
pub(super) type Mat3<T> = [T; 9];

#[inline(always)]
pub(super) fn dot<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn cross<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(super) fn add<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn sub<T: Real>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn rotate<T: Real>(m: &Mat3<T>, v: &Vec3<T>) -> Vec3<T> {
    std::array::from_fn(|i| m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2])
}

/// `row · M` for a row vector.
#[inline(always)]
pub(super) fn row_times<T: Real>(row: &Vec3<T>, m: &Mat3<T>) -> Vec3<T> {
    std::array::from_fn(|j| row[0] * m[j] + row[1] * m[3 + j] + row[2] * m[6 + j])
}

#[inline(always)]
pub(super) fn from_f64<T: Real, const N: usize>(v: [f64; N]) -> [T; N] {
    v.map(T::from_f64)
}

#[inline(always)]
pub(super) fn to_f64<T: Real, const N: usize>(v: [T; N]) -> [f64; N] {
    v.map(T::to_f64)
}
