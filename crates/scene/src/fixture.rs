//! A small reconstruction with exact observations, for the tests of this crate.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use glam::{DQuat, DVec2, DVec3};

use crate::{Image, Observation, Point, Reconstruction};

/// Images one unit apart on a line along x, looking along z at a grid of points five units away, each seen by all.
pub(crate) fn row_of_cameras(num_images: u32, num_points: u32) -> Reconstruction {
    let camera = Camera::with_default_params(1, CameraModel::SimpleRadial, 1000, 700);
    let poses: Vec<_> = (0..num_images)
        .map(|i| Rigid3::from_rotation_and_center(DQuat::IDENTITY, DVec3::new(f64::from(i), 0.0, 0.0)))
        .collect();
    let position = |p: u32| DVec3::new(f64::from(p % 3), 0.3 * f64::from(p / 3), 5.0);
    let images = poses.iter().enumerate().map(|(i, pose)| {
        let px = (0..num_points).map(|p| camera.project(pose.transform_point(position(p))).expect("in front"));
        Image {
            id: i as u32 + 1,
            name: format!("folder/image{i}.jpg"),
            camera: 0,
            cam_from_world: *pose,
            keypoints_px: px.collect::<Vec<_>>().into(),
            depths: None,
        }
    });
    let points = (0..num_points).map(|p| Point {
        id: u64::from(p) + 1,
        position: position(p),
        rgb: [0; 3],
        error_px: -1.0,
        observations: (0..num_images).map(|image| Observation { image, keypoint: p }).collect(),
    });
    let (images, points) = (images.collect(), points.collect());
    Reconstruction { cameras: vec![camera], images, points, ..Default::default() }
}

/// Moves one keypoint.
pub(crate) fn shift_keypoint(reconstruction: &mut Reconstruction, image: usize, keypoint: usize, by_px: DVec2) {
    let mut keypoints = reconstruction.images[image].keypoints_px.to_vec();
    keypoints[keypoint] += by_px;
    reconstruction.images[image].keypoints_px = keypoints.into();
}
