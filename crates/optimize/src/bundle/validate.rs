//! Checks a problem once, so that nothing later can index out of range or meet a NaN.

use epipole_geometry::camera::CameraFamily;

use super::problem::Problem;
use crate::error::OptimizeError;

impl Problem {
    /// Every array's length, every index and every number.
    pub fn validate(&self) -> Result<(), OptimizeError> {
        let images = self.cam_from_world.len();
        let observations = self.observation_image.len();
        length("image_camera", self.image_camera.len(), images)?;
        length("pose_freedom", self.pose_freedom.len(), images)?;
        length("refine_params", self.refine_params.len(), self.cameras.len())?;
        length("param_priors", self.param_priors.len(), self.cameras.len())?;
        length("track_start", self.track_start.len(), self.points.len() + 1)?;
        length("observation_px", self.observation_px.len(), observations)?;
        let limit = (u32::MAX / 4) as usize;
        for (what, count) in [("images", images), ("points", self.points.len()), ("observations", observations)] {
            if count > limit {
                return Err(OptimizeError::TooLarge { what, count, limit });
            }
        }
        self.validate_tracks(observations)?;
        indices("image_camera", &self.image_camera, "camera", self.cameras.len())?;
        indices("observation_image", &self.observation_image, "image", images)?;
        all("cam_from_world", "a finite pose with a unit rotation", &self.cam_from_world, |p| {
            p.is_finite() && (p.rotation.length_squared() - 1.0).abs() < 1e-6
        })?;
        all("points", "a finite position", &self.points, |p| p.is_finite())?;
        all("observation_px", "a finite pixel", &self.observation_px, |p| p.is_finite())?;
        all("cameras", "a camera with the model's number of finite parameters", &self.cameras, |c| {
            c.params.len() == c.model.num_params() && c.params.iter().all(|p| p.is_finite())
        })?;
        for (row, (priors, camera)) in self.param_priors.iter().zip(&self.cameras).enumerate() {
            for prior in priors {
                if prior.index >= camera.params.len() {
                    let (index, count) = (prior.index, camera.params.len());
                    return Err(OptimizeError::Index { array: "param_priors", row, target: "parameter", index, count });
                }
                let good = prior.mean.is_finite() && prior.sigma.is_finite() && prior.sigma > 0.0;
                ensure(good, "param_priors", row, "a finite mean with a positive sigma")?;
            }
        }
        ensure(self.loss.is_valid(), "loss", 0, "a loss with a positive finite scale")?;
        self.validate_depth(observations)
    }

    fn validate_depth(&self, observations: usize) -> Result<(), OptimizeError> {
        let Some(depth) = &self.depth else { return Ok(()) };
        length("depth.inverse", depth.inverse.len(), observations)?;
        length("depth.weight", depth.weight.len(), observations)?;
        all("depth.inverse", "a finite inverse depth, 0 or more", &depth.inverse, |v| v.is_finite() && *v >= 0.0)?;
        all("depth.weight", "a finite weight, 0 or more", &depth.weight, |v| v.is_finite() && *v >= 0.0)?;
        let spherical = |o: usize| {
            let camera = self.image_camera[self.observation_image[o] as usize];
            self.cameras[camera as usize].model.family() == CameraFamily::Spherical
        };
        for (o, &weight) in depth.weight.iter().enumerate() {
            ensure(weight == 0.0 || !spherical(o), "depth.weight", o, "0 in the images of spherical cameras")?;
        }
        ensure(depth.loss.is_valid(), "depth.loss", 0, "a loss with a positive finite scale")
    }

    fn validate_tracks(&self, observations: usize) -> Result<(), OptimizeError> {
        let expected = "offsets that start at 0, ascend and end at the number of observations";
        ensure(self.track_start.first() == Some(&0), "track_start", 0, expected)?;
        for (row, pair) in self.track_start.windows(2).enumerate() {
            ensure(pair[0] <= pair[1], "track_start", row + 1, expected)?;
        }
        let last = self.track_start.last().map(|&end| end as usize);
        ensure(last == Some(observations), "track_start", self.points.len(), expected)
    }
}

fn length(array: &'static str, found: usize, expected: usize) -> Result<(), OptimizeError> {
    if found == expected { Ok(()) } else { Err(OptimizeError::Length { array, found, expected }) }
}

fn indices(array: &'static str, values: &[u32], target: &'static str, count: usize) -> Result<(), OptimizeError> {
    match values.iter().position(|&i| i as usize >= count) {
        None => Ok(()),
        Some(row) => Err(OptimizeError::Index { array, row, target, index: values[row] as usize, count }),
    }
}

fn all<T>(
    array: &'static str,
    expected: &'static str,
    values: &[T],
    good: impl Fn(&T) -> bool,
) -> Result<(), OptimizeError> {
    match values.iter().position(|v| !good(v)) {
        None => Ok(()),
        Some(row) => Err(OptimizeError::Value { array, row, expected }),
    }
}

fn ensure(good: bool, array: &'static str, row: usize, expected: &'static str) -> Result<(), OptimizeError> {
    if good { Ok(()) } else { Err(OptimizeError::Value { array, row, expected }) }
}
