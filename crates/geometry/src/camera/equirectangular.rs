//! EQUIRECTANGULAR (17): longitude and latitude, every direction has a pixel.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::fisheye::TINY;
use super::scalar::Scalar;

/// `w, h`, px: `(atan2(u, w)/2π + ½)·W`, `(½ − atan2(−v, √(u² + w²))/π)·H` (source: `algorithms.md` §3.5).
/// `None` for the camera centre itself. At the poles, where longitude has no derivative, the derivatives are zero.
#[inline(always)]
pub(super) fn project<T: Scalar>(params: &[T], point: [T; 3]) -> Option<[T; 2]> {
    let [u, v, w] = point;
    let half = T::constant(0.5);
    let horizontal2 = u * u + w * w;
    if (horizontal2 + v * v).lowest() < TINY {
        return None;
    }
    // At a pole the root has no derivative without the offset, which is below rounding everywhere else.
    let horizontal = (horizontal2 + T::constant(TINY)).sqrt();
    let longitude = u.atan2(w);
    let latitude = (-v).atan2(horizontal);
    Some([
        (longitude * T::constant(1.0 / TAU) + half) * params[0],
        (half - latitude * T::constant(1.0 / PI)) * params[1],
    ])
}

/// The unit bearing at a pixel.
pub(super) fn ray_from_pixel(params: &[f64], px: DVec2) -> DVec3 {
    let (sin_longitude, cos_longitude) = ((px.x / params[0] - 0.5) * TAU).sin_cos();
    let (sin_latitude, cos_latitude) = ((0.5 - px.y / params[1]) * PI).sin_cos();
    DVec3::new(cos_latitude * sin_longitude, -sin_latitude, cos_latitude * cos_longitude)
}
