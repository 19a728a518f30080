//! A model as its files have it, by ids, before it is checked and indexed; and a reconstruction as they will have it.

use std::borrow::Cow;
use std::path::Path;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use epipole_scene::{Frame, NO_POINT, Reconstruction, Rig};
use glam::{DQuat, DVec2, DVec3};

use super::rigs;
use crate::error::{FormatError, Location, Problem};

/// Quaternions within this of unit length are kept as they are, so that reading changes no bit.
const UNIT_TOLERANCE: f64 = 1e-9;

/// What the files of a model hold.
#[derive(Debug, Default)]
pub(super) struct Model {
    pub(super) cameras: Vec<Camera>,
    pub(super) images: Vec<RawImage>,
    pub(super) points: Vec<RawPoint>,
    pub(super) rigs: Vec<Rig>,
    pub(super) frames: Vec<Frame>,
}

/// An image by ids.
#[derive(Debug)]
pub(super) struct RawImage {
    pub(super) id: u32,
    pub(super) name: String,
    pub(super) camera_id: u32,
    pub(super) cam_from_world: Rigid3,
    pub(super) keypoints_px: Vec<DVec2>,
    /// Per keypoint.
    pub(super) point_ids: Vec<u64>,
}

/// A point by ids.
#[derive(Debug)]
pub(super) struct RawPoint {
    pub(super) id: u64,
    pub(super) position: DVec3,
    pub(super) rgb: [u8; 3],
    pub(super) error_px: f64,
    /// (image id, keypoint)
    pub(super) track: Vec<(u32, u32)>,
}

/// The motion stored as `qw qx qy qz tx ty tz`; may be non-finite, which the caller checks.
pub(super) fn motion([w, x, y, z, tx, ty, tz]: [f64; 7]) -> Rigid3 {
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let norm = rotation.length();
    let rotation = if (norm - 1.0).abs() <= UNIT_TOLERANCE { rotation } else { rotation / norm };
    Rigid3 { rotation, translation: DVec3::new(tx, ty, tz) }
}

/// The opposite of [`motion`].
pub(super) fn motion_values(motion: &Rigid3) -> [f64; 7] {
    let (q, t) = (motion.rotation, motion.translation);
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
}

/// A reconstruction that has been found fit to be written.
pub(super) struct View<'a> {
    pub(super) reconstruction: &'a Reconstruction,
    pub(super) rigs: Cow<'a, [Rig]>,
    pub(super) frames: Cow<'a, [Frame]>,
    /// Per image and keypoint, the id of the point or [`NO_POINT`].
    pub(super) point_ids: Vec<Vec<u64>>,
}

impl<'a> View<'a> {
    pub(super) fn new(folder: &Path, reconstruction: &'a Reconstruction) -> Result<Self, FormatError> {
        let invalid = |row: String, problem| {
            FormatError::invalid(Location::file(folder).row(row), problem, "the reconstruction cannot be written")
        };
        for camera in &reconstruction.cameras {
            let (expected, found) = (camera.model.num_params(), camera.params.len());
            if expected != found {
                let (expected, found) = (expected as u128 * 8, found as u64 * 8);
                let problem = Problem::BlobLength { column: "params", expected, found };
                return Err(invalid(format!("camera {}", camera.id), problem));
            }
        }
        for image in &reconstruction.images {
            let problem = if image.camera >= reconstruction.cameras.len() {
                Problem::Dangling { what: "camera with index", id: image.camera.to_string() }
            } else if image.name.is_empty() || image.name.contains('\0') {
                Problem::Syntax { what: "a file name", found: image.name.escape_debug().to_string() }
            } else {
                continue;
            };
            return Err(invalid(format!("image {}", image.id), problem));
        }
        let mut point_ids: Vec<Vec<u64>> =
            reconstruction.images.iter().map(|image| vec![NO_POINT; image.keypoints_px.len()]).collect();
        for point in &reconstruction.points {
            for o in &point.observations {
                let slot = point_ids.get_mut(o.image as usize).and_then(|ids| ids.get_mut(o.keypoint as usize));
                let problem = match slot {
                    None => Problem::Dangling { what: "observation", id: format!("{}:{}", o.image, o.keypoint) },
                    Some(id) if *id != NO_POINT => {
                        let key = format!("{} of image index {}", o.keypoint, o.image);
                        Problem::Duplicate { what: "a point of keypoint", key }
                    }
                    Some(id) => {
                        *id = point.id;
                        continue;
                    }
                };
                return Err(invalid(format!("point {}", point.id), problem));
            }
        }
        let (rigs, frames) = rigs::for_writing(reconstruction);
        Ok(Self { reconstruction, rigs, frames, point_ids })
    }

    /// The ids of a point's track: (image id, keypoint).
    pub(super) fn track(&self, point: &'a epipole_scene::Point) -> impl Iterator<Item = (u32, u32)> + '_ {
        point.observations.iter().map(|o| (self.reconstruction.images[o.image as usize].id, o.keypoint))
    }
}
