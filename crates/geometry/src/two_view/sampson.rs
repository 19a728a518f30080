//! Residuals in pixels: how far a match is from an epipolar geometry or a homography.
//!
//! The Sampson error is the first-order distance of a pair of pixels from the nearest pair that fits exactly. Taken
//! through the derivative of the ray by the pixel it holds for any camera model ("tangent Sampson error",
//! M. Terekhov and V. Larsson, "Tangent Sampson Error: Fast Approximate Two-view Reprojection Error for Central
//! Camera Models", ICCV 2023).

use glam::{DMat3, DVec2, DVec3};

use super::correspondence::{Bearing, BearingPair, LANES, Lanes3};
use crate::camera::Camera;

/// The tangent Sampson error of a pair of pixels under an essential matrix between rays, px.
///
/// Infinite where a camera has no ray for its pixel or does not see along it, and where the pair lies on both
/// epipoles.
pub fn tangent_sampson_error_px(
    essential: &DMat3,
    camera1: &Camera,
    pixel1: DVec2,
    camera2: &Camera,
    pixel2: DVec2,
) -> f64 {
    let bearings = Bearing::from_pixel(camera1, pixel1).zip(Bearing::from_pixel(camera2, pixel2));
    let Some((first, second)) = bearings else { return f64::INFINITY };
    let squared = tangent_sampson_squared(essential, &BearingPair { first, second });
    if squared.is_nan() { f64::INFINITY } else { squared.sqrt() }
}

/// The squared tangent Sampson error, px²; NaN on both epipoles.
#[inline]
pub(super) fn tangent_sampson_squared(essential: &DMat3, pair: &BearingPair) -> f64 {
    let line2 = *essential * pair.first.ray;
    let line1 = essential.transpose() * pair.second.ray;
    let value = pair.second.ray.dot(line2);
    let [a, b] = pair.first.by_pixel.map(|d| d.dot(line1));
    let [c, d] = pair.second.by_pixel.map(|d| d.dot(line2));
    value * value / (a * a + b * b + c * c + d * d)
}

/// The Sampson error of a pair of pixels under a fundamental matrix, px; infinite where it is not defined (both
/// points on epipoles, or numbers that are not finite).
pub fn sampson_error_px(fundamental: &DMat3, pixel1: DVec2, pixel2: DVec2) -> f64 {
    let line2 = *fundamental * pixel1.extend(1.0);
    let line1 = fundamental.transpose() * pixel2.extend(1.0);
    let value = pixel2.extend(1.0).dot(line2);
    let error = value.abs() / (line1.truncate().length_squared() + line2.truncate().length_squared()).sqrt();
    if error.is_nan() { f64::INFINITY } else { error }
}

/// The distance of the transferred first pixel from the second, px; infinite where the homography sends it behind the
/// image plane.
pub fn homography_transfer_error_px(homography: &DMat3, pixel1: DVec2, pixel2: DVec2) -> f64 {
    let transferred = *homography * pixel1.extend(1.0);
    let error = (transferred.truncate() / transferred.z).distance(pixel2);
    if error.is_nan() || transferred.z * homography.determinant() <= 0.0 { f64::INFINITY } else { error }
}

#[inline(always)]
fn rows(m: &DMat3) -> [[f64; 3]; 3] {
    let t = m.transpose();
    [t.x_axis.to_array(), t.y_axis.to_array(), t.z_axis.to_array()]
}

#[inline(always)]
fn dot_lanes(row: [f64; 3], v: &Lanes3, lane: usize) -> f64 {
    row[0] * v[0][lane] + row[1] * v[1][lane] + row[2] * v[2][lane]
}

/// [`tangent_sampson_squared`] of a block: ray 1, its two derivatives, ray 2, its two derivatives.
#[inline]
pub(super) fn tangent_sampson_block(essential: &DMat3, block: &[Lanes3; 6], out: &mut [f64; LANES]) {
    let (e, et) = (rows(essential), rows(&essential.transpose()));
    let [r1, u1, v1, r2, u2, v2] = block;
    for l in 0..LANES {
        let line2 = [dot_lanes(e[0], r1, l), dot_lanes(e[1], r1, l), dot_lanes(e[2], r1, l)];
        let line1 = [dot_lanes(et[0], r2, l), dot_lanes(et[1], r2, l), dot_lanes(et[2], r2, l)];
        let value = dot_lanes(line2, r2, l);
        let (a, b) = (dot_lanes(line1, u1, l), dot_lanes(line1, v1, l));
        let (c, d) = (dot_lanes(line2, u2, l), dot_lanes(line2, v2, l));
        out[l] = value * value / (a * a + b * b + c * c + d * d);
    }
}

/// Squared Sampson errors of a block of image points (x, y, 1), in the units of the points.
#[inline]
pub(super) fn sampson_block(fundamental: &DMat3, block: &[Lanes3; 2], out: &mut [f64; LANES]) {
    let (f, ft) = (rows(fundamental), rows(&fundamental.transpose()));
    let [p1, p2] = block;
    for l in 0..LANES {
        let (a, b) = (dot_lanes(f[0], p1, l), dot_lanes(f[1], p1, l));
        let (c, d) = (dot_lanes(ft[0], p2, l), dot_lanes(ft[1], p2, l));
        let value = a * p2[0][l] + b * p2[1][l] + dot_lanes(f[2], p1, l);
        out[l] = value * value / (a * a + b * b + c * c + d * d);
    }
}

/// Squared transfer errors of a block, px²: ray 1, ray 2, and the two rows of ∂pixel/∂ray at ray 2. First order in the
/// error; infinite for rays sent to the other side.
#[inline]
pub(super) fn transfer_block(homography: &DMat3, block: &[Lanes3; 4], out: &mut [f64; LANES]) {
    let h = rows(homography);
    let [r1, r2, u2, v2] = block;
    for l in 0..LANES {
        let sent = [dot_lanes(h[0], r1, l), dot_lanes(h[1], r1, l), dot_lanes(h[2], r1, l)];
        let along = dot_lanes(sent, r2, l);
        let (x, y) = (dot_lanes(sent, u2, l), dot_lanes(sent, v2, l));
        let squared = (x * x + y * y) / (along * along);
        out[l] = if along > 0.0 { squared } else { f64::INFINITY };
    }
}

/// The vectors of a pair in the order of [`tangent_sampson_block`].
pub(super) fn epipolar_vectors(pair: &BearingPair) -> [DVec3; 6] {
    let ([u1, v1], [u2, v2]) = (pair.first.by_pixel, pair.second.by_pixel);
    [pair.first.ray, u1, v1, pair.second.ray, u2, v2]
}

/// The vectors of a pair in the order of [`transfer_block`].
pub(super) fn transfer_vectors(pair: &BearingPair) -> [DVec3; 4] {
    let [u2, v2] = pair.second.pixel_by_ray;
    [pair.first.ray, pair.second.ray, u2, v2]
}
