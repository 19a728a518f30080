//! The small file beside depth maps that were not taken by the camera of the images: intrinsics and where it sat.

use std::fs;
use std::path::Path;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use glam::{DQuat, DVec3};
use serde::Deserialize;

use crate::error::{FormatError, Location, Problem};

/// The name it is looked for under, in the folder of the depth maps.
pub const SIDECAR_NAME: &str = "depth.json";

/// What a person should do about a bad one.
const ADVICE: &str = "write for instance {\"depth_camera\": {\"model\": \"PINHOLE\", \"width\": 640, \"height\": 480, \
    \"params\": [585, 585, 320, 240]}, \"color_from_depth\": {\"rotation_wxyz\": [1, 0, 0, 0], \
    \"translation_m\": [0.025, 0, 0]}}";

/// How far a rotation's quaternion may be from unit length: rounding to four digits.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What a sidecar says. Without a depth camera, the maps have the field of view and the distortion of the images.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthSidecar {
    /// The camera that took the maps; maps of other sizes are of the same field of view.
    pub depth_camera: Option<Camera>,
    /// The camera of the images as far as drawing the maps into them goes; if not given, the database's.
    pub color_camera: Option<Camera>,
    /// From the frame of the depth camera to that of the images' camera.
    pub color_from_depth: Option<Rigid3>,
    /// The number that stands for full confidence in confidence maps, for instance 2 for ARKit's levels.
    pub full_confidence: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    depth_camera: Option<WrittenCamera>,
    color_camera: Option<WrittenCamera>,
    color_from_depth: Option<WrittenMotion>,
    full_confidence: Option<f64>,
    /// For people.
    #[serde(rename = "comment")]
    _comment: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenCamera {
    model: String,
    width: u64,
    height: u64,
    params: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenMotion {
    rotation_wxyz: [f64; 4],
    translation_m: [f64; 3],
}

impl DepthSidecar {
    /// Reads a sidecar.
    ///
    /// # Errors
    /// Not JSON, unknown names, a camera whose parameters do not fit its model, a rotation that is none, a motion without
    /// the camera it belongs to.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let text = fs::read_to_string(path).map_err(|e| FormatError::io(path, e))?;
        Self::from_text(&text, path)
    }

    /// Reads a sidecar that is in memory; errors name `path`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_text(text: &str, path: &Path) -> Result<Self, FormatError> {
        parse(text).map_err(|problem| FormatError::invalid(Location::file(path), problem, ADVICE))
    }

    /// Whether the maps must be drawn into the images' camera before they are sampled.
    pub fn needs_registration(&self) -> bool {
        self.depth_camera.is_some()
    }
}

pub(super) fn parse(text: &str) -> Result<DepthSidecar, Problem> {
    let written: Written = serde_json::from_str(text).map_err(|e| Problem::WrongKind {
        expected: "a description of a depth camera in JSON",
        reason: e.to_string(),
    })?;
    let read = |name, camera: Option<WrittenCamera>| camera.map(|c| to_camera(name, c)).transpose();
    let sidecar = DepthSidecar {
        depth_camera: read("depth_camera", written.depth_camera)?,
        color_camera: read("color_camera", written.color_camera)?,
        color_from_depth: written.color_from_depth.map(to_motion).transpose()?,
        full_confidence: written.full_confidence,
    };
    let is_alone = sidecar.color_from_depth.is_some() || sidecar.color_camera.is_some();
    if sidecar.depth_camera.is_none() && is_alone {
        return Err(Problem::Inconsistent("color_from_depth and color_camera say nothing without depth_camera".into()));
    }
    if sidecar.full_confidence.is_some_and(|full| !(full > 0.0 && full.is_finite())) {
        return Err(Problem::Inconsistent("full_confidence is not a positive number".into()));
    }
    Ok(sidecar)
}

fn to_camera(name: &str, written: WrittenCamera) -> Result<Camera, Problem> {
    let model = CameraModel::from_name(&written.model)
        .ok_or_else(|| Problem::UnknownCameraModel(format!("{} of {name}", written.model)))?;
    let camera = Camera {
        id: 0,
        model,
        width_px: written.width,
        height_px: written.height,
        params: written.params,
        has_prior_focal: true,
    };
    camera.validate().map_err(|e| Problem::Inconsistent(format!("{name}: {e}")))?;
    if camera.width_px == 0 || camera.height_px == 0 {
        return Err(Problem::Inconsistent(format!("{name}: width or height is 0")));
    }
    Ok(camera)
}

fn to_motion(written: WrittenMotion) -> Result<Rigid3, Problem> {
    let [w, x, y, z] = written.rotation_wxyz;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let translation = DVec3::from_array(written.translation_m);
    if !translation.is_finite() {
        return Err(Problem::NotFinite("translation_m".into()));
    }
    if !rotation.is_finite() || (rotation.length() - 1.0).abs() > UNIT_TOLERANCE {
        return Err(Problem::OutOfRange {
            what: "the length of rotation_wxyz".into(),
            found: rotation.length().to_string(),
            expected: "1".into(),
        });
    }
    Ok(Rigid3::new(rotation, translation))
}
