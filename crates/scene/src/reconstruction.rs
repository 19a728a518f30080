//! The output of the pipeline and the content of a COLMAP model: cameras, posed images, points with their tracks.

use std::sync::Arc;

use epipole_geometry::camera::Camera;
use epipole_geometry::{Rigid3, Similarity3};
use glam::{DVec2, DVec3};

use crate::ImageDepths;

/// What an image's keypoint refers to when it observes no point, as COLMAP writes it.
pub const NO_POINT: u64 = u64::MAX;

/// Cameras, images and points, indexed densely; the order is the order in the files.
///
/// Tracks live in the points only; an image's point references are derived from them, so the two cannot disagree.
#[derive(Clone, Debug, Default)]
pub struct Reconstruction {
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// Posed images.
    pub images: Vec<Image>,
    /// Points.
    pub points: Vec<Point>,
    /// Rigs; empty for a model of COLMAP before 3.12 (then one rig per camera is meant).
    pub rigs: Vec<Rig>,
    /// Frames; empty as `rigs`.
    pub frames: Vec<Frame>,
}

/// A posed image.
#[derive(Clone, Debug)]
pub struct Image {
    /// COLMAP's image id.
    pub id: u32,
    /// File name, relative to the image folder.
    pub name: String,
    /// Index into [`Reconstruction::cameras`].
    pub camera: usize,
    /// World to camera.
    pub cam_from_world: Rigid3,
    /// All keypoints in database order, px.
    pub keypoints_px: Arc<[DVec2]>,
    /// Depths of the keypoints, one each, if they were given; not part of any model on disk.
    pub depths: Option<Arc<ImageDepths>>,
}

/// A point with its track.
#[derive(Clone, Debug)]
pub struct Point {
    /// COLMAP's point id, unique, positive.
    pub id: u64,
    /// Position in the world.
    pub position: DVec3,
    /// Colour, sRGB.
    pub rgb: [u8; 3],
    /// Mean reprojection error, px; −1 if unknown.
    pub error_px: f64,
    /// The keypoints that see it.
    pub observations: Vec<Observation>,
}

/// A keypoint of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Observation {
    /// Index into [`Reconstruction::images`].
    pub image: u32,
    /// Index into that image's keypoints.
    pub keypoint: u32,
}

/// A sensor of a rig: COLMAP's sensor type (0 = camera, 1 = IMU) and id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SensorId {
    /// −1 invalid, 0 camera, 1 IMU.
    pub kind: i32,
    /// The camera id, for a camera.
    pub id: u32,
}

/// Sensors that move together.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// COLMAP's rig id.
    pub id: u32,
    /// The sensor whose frame is the rig's frame; `None` for a rig without sensors.
    pub reference: Option<SensorId>,
    /// The other sensors.
    pub sensors: Vec<RigSensor>,
}

/// A sensor that is not the reference of its rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigSensor {
    /// Which sensor.
    pub sensor: SensorId,
    /// Its pose in the rig, if known.
    pub sensor_from_rig: Option<Rigid3>,
}

/// One instant of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// COLMAP's frame id.
    pub id: u32,
    /// COLMAP's rig id.
    pub rig_id: u32,
    /// World to rig.
    pub rig_from_world: Rigid3,
    /// Which sensor delivered which data (for a camera, the image id).
    pub data: Vec<(SensorId, u64)>,
}

impl Reconstruction {
    /// For every image, the point each keypoint observes (an index into `points`), or `None`.
    pub fn point_of_keypoint(&self) -> Vec<Vec<Option<u32>>> {
        let mut of: Vec<Vec<Option<u32>>> = self.images.iter().map(|i| vec![None; i.keypoints_px.len()]).collect();
        for (p, point) in self.points.iter().enumerate() {
            for o in &point.observations {
                of[o.image as usize][o.keypoint as usize] = Some(p as u32);
            }
        }
        of
    }

    /// Moves the whole scene.
    pub fn transform(&mut self, new_from_old: &Similarity3) {
        for image in &mut self.images {
            image.cam_from_world = new_from_old.transform_camera(&image.cam_from_world);
        }
        for point in &mut self.points {
            point.position = new_from_old.transform_point(point.position);
        }
    }

    /// Reprojection error of one observation, px; infinite where the point does not project.
    pub fn reprojection_error_px(&self, point: &Point, observation: Observation) -> f64 {
        let image = &self.images[observation.image as usize];
        let in_cam = image.cam_from_world.transform_point(point.position);
        self.cameras[image.camera].reprojection_error_px(in_cam, image.keypoints_px[observation.keypoint as usize])
    }

    /// Number of observations of all points.
    pub fn num_observations(&self) -> usize {
        self.points.iter().map(|p| p.observations.len()).sum()
    }
}
