//! The global positioning problem as plain data: where the cameras and points are, given every ray's direction.

use crate::error::OptimizeError;
use glam::DVec3;

/// Camera centres and points from rays of known direction: minimise `Σ ω ρ(‖v − s (X − C)‖²)` over centres `C`, points
/// `X` and one scale `s` per observation (GLOMAP's residual; BATA, Zhuang et al., CVPR 2018).
///
/// Structure of arrays. Observations are sorted by point. Building one needs no device, and nothing in it is random.
/// The answer is defined up to a translation and a scale, unless [`Problem::pinned_scale`] gives distances.
#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// Camera centres in the world, one per image: **output**, the values before the solve are not used.
    pub centers: Vec<DVec3>,
    /// Points in the world: **output**, the values before the solve are not used.
    pub points: Vec<DVec3>,
    /// ω per image, positive: 1, or 0.5 for images whose camera has no prior focal length (GLOMAP).
    pub image_weight: Vec<f64>,
    /// `points.len() + 1` offsets: observations of point `p` are `track_start[p]..track_start[p + 1]`.
    pub track_start: Vec<u32>,
    /// Image of each observation, an index into `centers`.
    pub observation_image: Vec<u32>,
    /// Unit ray from the camera centre to the point, in the **world** frame, per observation.
    pub observation_ray: Vec<DVec3>,
    /// Metric depth: per observation 1 / ray length (world units⁻¹, along the ray, not the z-depth), 0 where unknown.
    /// `None` when nothing is known.
    pub pinned_scale: Option<Vec<f64>>,
    /// Relative standard deviation of each pinned length, which weighs the pin against the rays ([`PIN_SIGMA`]). `None`: all
    /// pins weigh as much as a ray. Entries of observations without a pin are not used.
    pub pin_sigma: Option<Vec<f64>>,
}

/// A pinned observation of this relative uncertainty weighs half as much as a ray, `ω / (1 + (σ/σ₀)²)`: its residual holds
/// the depth's error as well as the ray's, and this is where its loss bends.
pub const PIN_SIGMA: f64 = 0.1;

/// How far a ray's length may be from 1: generous for rays rotated in `f32`, far too small to change an answer.
const UNIT_TOLERANCE: f64 = 1e-4;

impl Problem {
    /// Checks every array's length and every number, so that nothing later can index out of range or meet a NaN.
    ///
    /// # Errors
    /// [`OptimizeError`] with the array, the row and what is expected of it.
    pub fn validate(&self) -> Result<(), OptimizeError> {
        let observations = self.observation_image.len();
        for (what, count) in
            [("observations", observations), ("points", self.points.len()), ("images", self.centers.len())]
        {
            if count >= u32::MAX as usize {
                return Err(OptimizeError::TooLarge { what, count, limit: u32::MAX as usize - 1 });
            }
        }
        length("image_weight", self.image_weight.len(), self.centers.len())?;
        length("track_start", self.track_start.len(), self.points.len() + 1)?;
        length("observation_ray", self.observation_ray.len(), observations)?;
        if let Some(pins) = &self.pinned_scale {
            length("pinned_scale", pins.len(), observations)?;
        }
        if let Some(sigmas) = &self.pin_sigma {
            length("pin_sigma", sigmas.len(), observations)?;
            each("pin_sigma", sigmas, "a finite number, 0 or more", |s| s.is_finite() && **s >= 0.0)?;
        }
        let first = self.track_start[0];
        let last = self.track_start[self.points.len()];
        let sorted = self.track_start.windows(2).position(|pair| pair[1] < pair[0]);
        if first != 0 || last as usize != observations || sorted.is_some() {
            let row = sorted.unwrap_or(if first != 0 { 0 } else { self.points.len() });
            return Err(OptimizeError::Value {
                array: "track_start",
                row,
                expected: "offsets that start at 0, never fall and end at the number of observations",
            });
        }
        each("image_weight", &self.image_weight, "a finite number above 0", |w| w.is_finite() && **w > 0.0)?;
        let images = self.centers.len();
        if let Some(row) = self.observation_image.iter().position(|&image| image as usize >= images) {
            let index = self.observation_image[row] as usize;
            return Err(OptimizeError::Index {
                array: "observation_image",
                row,
                target: "image",
                index,
                count: images,
            });
        }
        each("observation_ray", &self.observation_ray, "a finite vector of length 1", |ray| {
            // Not `> tolerance`: a NaN must fail the test.
            (ray.length() - 1.0).abs() <= UNIT_TOLERANCE
        })?;
        if let Some(pins) = &self.pinned_scale {
            each("pinned_scale", pins, "0, or a finite 1 / ray length above 0", |s| s.is_finite() && **s >= 0.0)?;
        }
        Ok(())
    }

    /// Number of observations.
    pub fn observations(&self) -> usize {
        self.observation_image.len()
    }

    /// The range of observations of a point.
    pub(crate) fn track(&self, point: usize) -> std::ops::Range<usize> {
        self.track_start[point] as usize..self.track_start[point + 1] as usize
    }

    /// ω of an observation: its image's, less where a pin is uncertain.
    pub(crate) fn weight(&self, observation: usize) -> f64 {
        let weight = self.image_weight[self.observation_image[observation] as usize];
        match (self.pin(observation), &self.pin_sigma) {
            (Some(_), Some(sigma)) => weight / (1.0 + (sigma[observation] / PIN_SIGMA).powi(2)),
            _ => weight,
        }
    }

    /// 1 / ray length where it is pinned.
    pub(crate) fn pin(&self, observation: usize) -> Option<f64> {
        self.pinned_scale.as_ref().map(|pins| pins[observation]).filter(|&scale| scale > 0.0)
    }
}

fn length(array: &'static str, found: usize, expected: usize) -> Result<(), OptimizeError> {
    if found == expected { Ok(()) } else { Err(OptimizeError::Length { array, found, expected }) }
}

fn each<T>(
    array: &'static str,
    values: &[T],
    expected: &'static str,
    ok: impl Fn(&&T) -> bool,
) -> Result<(), OptimizeError> {
    match values.iter().position(|value| !ok(&value)) {
        None => Ok(()),
        Some(row) => Err(OptimizeError::Value { array, row, expected }),
    }
}
