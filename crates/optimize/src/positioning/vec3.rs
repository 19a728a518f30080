//! Three numbers of the solver's own precision; glam has no vector that is generic over it.

use epipole_geometry::camera::Real;
use glam::DVec3;

/// A vector in the world frame.
pub(crate) type Vec3<T> = [T; 3];

#[inline(always)]
pub(crate) fn zero<T: Real>() -> Vec3<T> {
    [T::ZERO; 3]
}

#[inline(always)]
pub(crate) fn sub<T: Real>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn add<T: Real>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn scale<T: Real>(a: Vec3<T>, s: T) -> Vec3<T> {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
pub(crate) fn dot<T: Real>(a: Vec3<T>, b: Vec3<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Rounded from `f64`.
#[inline(always)]
pub(crate) fn from_dvec3<T: Real>(v: DVec3) -> Vec3<T> {
    [T::from_f64(v.x), T::from_f64(v.y), T::from_f64(v.z)]
}

/// Widened to `f64`.
#[inline(always)]
pub(crate) fn to_dvec3<T: Real>(v: Vec3<T>) -> DVec3 {
    DVec3::new(v[0].to_f64(), v[1].to_f64(), v[2].to_f64())
}
