//! A camera: a model, its parameters and the size of its images.

use glam::{DVec2, DVec3};

use super::model::{CameraFamily, CameraModel};
use super::projection::project;
use super::unprojection::ray_from_pixel;

/// COLMAP's default focal length in units of the larger image side, for images without EXIF
/// (`default_focal_length_factor`, source: `algorithms.md` §3.5).
pub const DEFAULT_FOCAL_FACTOR: f64 = 1.2;

/// A focal length outside these multiples of the larger image side is bogus (source: `algorithms.md` §2.10).
const PLAUSIBLE_FOCAL_RATIO: [f64; 2] = [0.1, 10.0];

/// A distortion parameter larger than this is bogus (source: `algorithms.md` §2.10).
const PLAUSIBLE_EXTRA: f64 = 1.0;

/// The FOV model has no distortion at ω = 0, but neither a derivative; COLMAP starts it here.
const DEFAULT_FOV_OMEGA_RAD: f64 = 1e-2;

/// Intrinsics shared by one or more images.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// COLMAP's camera id.
    pub id: u32,
    /// The model.
    pub model: CameraModel,
    /// Image width, px.
    pub width_px: u64,
    /// Image height, px.
    pub height_px: u64,
    /// Parameters in COLMAP's order, as many as the model has: whoever reads a camera from outside calls
    /// [`Camera::validate`], everything else relies on it.
    pub params: Vec<f64>,
    /// Whether the focal length is known (from EXIF or from a person) rather than guessed.
    pub has_prior_focal: bool,
}

/// What makes a camera unusable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// The parameter list does not fit the model.
    #[error(
        "camera {camera} ({model}) has {found} parameters, the model needs {expected} ({names}); \
         correct the camera's parameter list"
    )]
    ParamCount {
        /// COLMAP's camera id.
        camera: u32,
        /// COLMAP's model name.
        model: &'static str,
        /// Number of parameters found.
        found: usize,
        /// Number of parameters the model has.
        expected: usize,
        /// Their names.
        names: String,
    },
    /// NaN or infinity.
    #[error("camera {camera} ({model}): parameter {name} is {value}, not a finite number; correct it")]
    NotFinite {
        /// COLMAP's camera id.
        camera: u32,
        /// COLMAP's model name.
        model: &'static str,
        /// The parameter's name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A focal length (or, for the equirectangular model, an image size) that is zero or negative.
    #[error("camera {camera} ({model}): {name} is {value}, it must be positive; correct it")]
    NotPositive {
        /// COLMAP's camera id.
        camera: u32,
        /// COLMAP's model name.
        model: &'static str,
        /// The parameter's name.
        name: &'static str,
        /// Its value, px.
        value: f64,
    },
}

impl Camera {
    /// A camera with nothing known but the size of its images: focal length [`DEFAULT_FOCAL_FACTOR`] times the larger
    /// side, principal point in the middle, no distortion, no prior.
    pub fn with_default_params(id: u32, model: CameraModel, width_px: u64, height_px: u64) -> Self {
        let focal_px = DEFAULT_FOCAL_FACTOR * width_px.max(height_px) as f64;
        Self::with_focal(id, model, width_px, height_px, focal_px)
    }

    /// A camera with the given focal length, principal point in the middle, no distortion, no prior.
    pub fn with_focal(id: u32, model: CameraModel, width_px: u64, height_px: u64, focal_px: f64) -> Self {
        let middle_px = [width_px as f64 / 2.0, height_px as f64 / 2.0];
        let mut params = vec![0.0; model.num_params()];
        for &i in model.focal_params() {
            params[i] = focal_px;
        }
        for (&i, px) in model.principal_point_params().iter().zip(middle_px) {
            params[i] = px;
        }
        match model {
            CameraModel::Equirectangular => params = vec![width_px as f64, height_px as f64],
            CameraModel::Fov => params[4] = DEFAULT_FOV_OMEGA_RAD,
            // α = 0, β = 1 is the pinhole camera.
            CameraModel::Eucm => params[5] = 1.0,
            _ => {}
        }
        Self { id, model, width_px, height_px, params, has_prior_focal: false }
    }

    /// The pixel of a point in the camera frame.
    pub fn project(&self, point_in_cam: DVec3) -> Option<DVec2> {
        project(self.model, &self.params, point_in_cam.to_array()).map(DVec2::from_array)
    }

    /// The unit bearing, in the camera frame, of what is seen at a pixel; `None` where the distortion has no inverse.
    pub fn ray_from_pixel(&self, px: DVec2) -> Option<DVec3> {
        ray_from_pixel(self.model, &self.params, px)
    }

    /// The point on the plane z = 1 seen at a pixel; `None` where there is none (a ray that does not point forward).
    pub fn unproject(&self, px: DVec2) -> Option<DVec2> {
        let ray = self.ray_from_pixel(px)?;
        (ray.z > f64::EPSILON).then(|| ray.truncate() / ray.z)
    }

    /// Distance between the projection of a point in the camera frame and a pixel, px; infinite where the point does not
    /// project. For the equirectangular model it is the angle times the pixels per radian (width/2π), so that neither
    /// the seam nor the poles count as far away.
    pub fn reprojection_error_px(&self, point_in_cam: DVec3, px: DVec2) -> f64 {
        if self.model.family() == CameraFamily::Spherical {
            return match (point_in_cam.try_normalize(), self.ray_from_pixel(px)) {
                (Some(seen), Some(ray)) => angle_between(seen, ray) * self.params[0] / std::f64::consts::TAU,
                _ => f64::INFINITY,
            };
        }
        self.project(point_in_cam).map_or(f64::INFINITY, |projected| projected.distance(px))
    }

    /// The mean of the focal lengths, px. For the equirectangular model, which has none, the pixels per radian.
    pub fn mean_focal_px(&self) -> f64 {
        let indices = self.model.focal_params();
        if indices.is_empty() {
            return self.params[0] / std::f64::consts::TAU;
        }
        indices.iter().map(|&i| self.params[i]).sum::<f64>() / indices.len() as f64
    }

    /// Sets every focal length; nothing for the equirectangular model.
    pub fn set_focal_px(&mut self, focal_px: f64) {
        for &i in self.model.focal_params() {
            self.params[i] = focal_px;
        }
    }

    /// The principal point, px; the middle of the image for the equirectangular model.
    pub fn principal_point_px(&self) -> DVec2 {
        match *self.model.principal_point_params() {
            [x, y] => DVec2::new(self.params[x], self.params[y]),
            _ => DVec2::new(self.params[0], self.params[1]) / 2.0,
        }
    }

    /// The same rays for an image of another size: focal lengths and principal point scaled with the sides.
    pub fn rescaled(&self, width_px: u64, height_px: u64) -> Self {
        let scale = [width_px as f64 / self.width_px as f64, height_px as f64 / self.height_px as f64];
        let mut out = Self { width_px, height_px, ..self.clone() };
        match *self.model.focal_params() {
            [f] => out.params[f] *= 0.5 * (scale[0] + scale[1]),
            [fx, fy] => {
                out.params[fx] *= scale[0];
                out.params[fy] *= scale[1];
            }
            _ => out.params = vec![width_px as f64, height_px as f64],
        }
        for (&i, s) in self.model.principal_point_params().iter().zip(scale) {
            out.params[i] *= s;
        }
        out
    }

    /// Checks that the parameters are as many as the model has, finite, and the focal lengths positive.
    pub fn validate(&self) -> Result<(), CameraError> {
        let (camera, model, names) = (self.id, self.model.name(), self.model.param_names());
        if self.params.len() != names.len() {
            return Err(CameraError::ParamCount {
                camera,
                model,
                found: self.params.len(),
                expected: names.len(),
                names: names.join(", "),
            });
        }
        for (&name, &value) in names.iter().zip(&self.params) {
            if !value.is_finite() {
                return Err(CameraError::NotFinite { camera, model, name, value });
            }
        }
        let sizes: &[usize] =
            if self.model == CameraModel::Equirectangular { &[0, 1] } else { self.model.focal_params() };
        match sizes.iter().find(|&&i| self.params[i] <= 0.0) {
            Some(&i) => Err(CameraError::NotPositive { camera, model, name: names[i], value: self.params[i] }),
            None => Ok(()),
        }
    }

    /// Whether an estimate of the parameters has gone astray: a focal length outside 0.1 to 10 times the larger image
    /// side, or a distortion parameter beyond ±1 (source: `algorithms.md` §2.10). EUCM's β, a shape and not a
    /// distortion, is around 1 by nature and is not judged.
    pub fn has_bogus_params(&self) -> bool {
        let side_px = self.width_px.max(self.height_px) as f64;
        let [least, most] = PLAUSIBLE_FOCAL_RATIO.map(|ratio| ratio * side_px);
        let bogus_focal = self.model.focal_params().iter().any(|&i| !(least..=most).contains(&self.params[i]));
        let bogus_extra = self.model.extra_params().iter().any(|&i| {
            let shape = self.model == CameraModel::Eucm && i == 5;
            let value = self.params[i];
            !value.is_finite() || (!shape && value.abs() > PLAUSIBLE_EXTRA)
        });
        bogus_focal || bogus_extra
    }
}

/// The angle between two unit vectors, exact also where it is tiny, rad.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_plausible_and_centred() {
        for model in CameraModel::ALL {
            let camera = Camera::with_default_params(3, model, 640, 480);
            assert_eq!(camera.validate(), Ok(()), "{model:?}");
            assert!(!camera.has_bogus_params(), "{model:?}");
            assert_eq!(camera.principal_point_px(), DVec2::new(320.0, 240.0), "{model:?}");
            if model != CameraModel::Equirectangular {
                assert_eq!(camera.mean_focal_px(), 768.0, "{model:?}");
            }
            let px = camera.project(DVec3::Z).expect("the axis is in front of every camera");
            assert!(px.distance(camera.principal_point_px()) < 1e-9, "{model:?}");
        }
    }

    #[test]
    fn bad_cameras_are_named() {
        let mut camera = Camera::with_default_params(7, CameraModel::OpenCv, 640, 480);
        camera.params[1] = 0.0;
        assert!(matches!(camera.validate(), Err(CameraError::NotPositive { camera: 7, name: "fy", .. })));
        camera.params[6] = f64::NAN;
        assert!(matches!(camera.validate(), Err(CameraError::NotFinite { name: "p1", .. })));
        assert!(camera.has_bogus_params());
        camera.params.pop();
        let message = camera.validate().expect_err("too few parameters").to_string();
        assert!(message.contains("camera 7") && message.contains("OPENCV") && message.contains("7 parameters"));
    }

    #[test]
    fn bogus_parameters_are_seen() {
        let good = Camera::with_default_params(1, CameraModel::SimpleRadial, 1000, 500);
        for (index, value, bogus) in [(0, 99.0, true), (0, 10_001.0, true), (0, 101.0, false), (3, -1.01, true)] {
            let mut camera = good.clone();
            camera.params[index] = value;
            assert_eq!(camera.has_bogus_params(), bogus, "{index} {value}");
        }
    }

    #[test]
    fn a_rescaled_camera_keeps_its_rays() {
        for model in CameraModel::ALL {
            let camera = Camera::with_default_params(1, model, 640, 480);
            let half = camera.rescaled(320, 240);
            let point = DVec3::new(0.2, -0.1, 1.0);
            let (a, b) = (camera.project(point).expect("in front"), half.project(point).expect("in front"));
            assert!((a / 2.0 - b).length() < 1e-9, "{model:?}");
        }
    }

    #[test]
    fn the_equirectangular_error_knows_the_seam() {
        let camera = Camera::with_default_params(1, CameraModel::Equirectangular, 1000, 500);
        let behind = DVec3::new(1e-3, 0.0, -1.0);
        let error = camera.reprojection_error_px(behind, DVec2::new(0.0, 250.0));
        assert!((error - 1e-3 * 1000.0 / std::f64::consts::TAU).abs() < 1e-4, "{error}");
    }
}
