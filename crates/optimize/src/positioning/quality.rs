//! Signs of failure that need no ground truth: how well the rays meet.

use epipole_geometry::camera::Real;

use super::gauge::{Positions, median};
use super::layout::{Layout, Rays};
use super::vec3::to_dvec3;

/// A ray that passes its point within this angle agrees with it.
const AGREEMENT_RAD: f64 = 1.0 * std::f64::consts::PI / 180.0;
/// Cameras with fewer observations say nothing about failure: one bad track weighs too much.
const MIN_OBSERVATIONS: usize = 30;
/// Below these a solve has probably failed (`global-positioning.md` §5.4; failed runs had 0.09 to 0.43 and 0.01 to 0.2).
const SUSPICIOUS_SHARE: f64 = 0.5;
const SUSPICIOUS_CAMERA: f64 = 0.25;
/// Above these a solve was good wherever it was checked (same section).
const GOOD_SHARE: f64 = 0.92;
const GOOD_CAMERA: f64 = 0.75;

/// How well rays and positions agree. Wrong rotations and focal lengths are invisible here
/// (`global-positioning.md` §5.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Share of observations whose ray passes the point within 1°.
    pub agreeing_share: f64,
    /// The lowest such share over cameras with 30 or more observations; `None` without such a camera.
    pub worst_camera_share: Option<f64>,
    /// Median angle between ray and direction to the point, rad.
    pub median_angle_rad: f64,
    /// Share of observations whose point lies behind the camera.
    pub behind_share: f64,
}

/// What [`Quality`] amounts to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Probably failed.
    Suspicious,
    /// Bundle adjustment and retriangulation have repaired such results.
    Recoverable,
    /// As good solves look.
    Good,
}

impl Quality {
    /// Thresholds of `global-positioning.md` §5.4.
    pub fn grade(&self) -> Grade {
        let camera = self.worst_camera_share.unwrap_or(1.0);
        if self.agreeing_share < SUSPICIOUS_SHARE || camera < SUSPICIOUS_CAMERA {
            Grade::Suspicious
        } else if self.agreeing_share < GOOD_SHARE || camera < GOOD_CAMERA {
            Grade::Recoverable
        } else {
            Grade::Good
        }
    }
}

/// Angle between the ray and the direction to the point per observation, rad; π where the point is on the camera.
pub(crate) fn angles<T: Real>(layout: &Layout, rays: &Rays<T>, positions: &Positions<T>) -> Vec<f64> {
    (0..layout.observations())
        .map(|o| {
            let (ray, d) = (to_dvec3(rays.direction[o]), to_dvec3(positions.difference(layout, o)));
            if d.length_squared() > 0.0 { ray.cross(d).length().atan2(ray.dot(d)) } else { std::f64::consts::PI }
        })
        .collect()
}

/// Summarises [`angles`].
pub(crate) fn quality(layout: &Layout, angles: &[f64]) -> Quality {
    let agrees = |angle: f64| angle < AGREEMENT_RAD;
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    let worst = (0..layout.cameras())
        .map(|camera| layout.of_camera(camera))
        .filter(|observations| observations.len() >= MIN_OBSERVATIONS)
        .map(|observations| {
            share(observations.iter().filter(|&&o| agrees(angles[o as usize])).count(), observations.len())
        })
        .reduce(f64::min);
    Quality {
        agreeing_share: share(angles.iter().filter(|&&a| agrees(a)).count(), angles.len()),
        worst_camera_share: worst,
        median_angle_rad: median(angles.iter().copied()).unwrap_or(0.0),
        behind_share: share(angles.iter().filter(|&&a| a >= std::f64::consts::FRAC_PI_2).count(), angles.len()),
    }
}
