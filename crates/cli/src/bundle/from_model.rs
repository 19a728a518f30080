//! A COLMAP model as a bundle problem and back.

use epipole_geometry::camera::{Camera, MAX_PARAMS};
use epipole_optimize::Loss;
use epipole_optimize::bundle::{PoseFreedom, Problem};
use epipole_scene::Reconstruction;
use epipole_scene::statistics::update_point_errors;

use crate::args::BundleIntrinsics;
use crate::error::CliError;

/// The problem: all poses free, principal points fixed.
pub(super) fn problem(reconstruction: &Reconstruction, intrinsics: BundleIntrinsics) -> Result<Problem, CliError> {
    let total = reconstruction.num_observations();
    if u32::try_from(total).is_err() {
        return Err(CliError::Usage(format!("the model has {total} observations, more than can be indexed; split it")));
    }
    let mut problem = Problem {
        cam_from_world: reconstruction.images.iter().map(|i| i.cam_from_world).collect(),
        image_camera: reconstruction.images.iter().map(|i| i.camera as u32).collect(),
        pose_freedom: vec![PoseFreedom::Free; reconstruction.images.len()],
        cameras: reconstruction.cameras.clone(),
        refine_params: reconstruction.cameras.iter().map(|c| moving(c, intrinsics)).collect(),
        param_priors: vec![Vec::new(); reconstruction.cameras.len()],
        points: reconstruction.points.iter().map(|p| p.position).collect(),
        fixed_points: false,
        track_start: Vec::with_capacity(reconstruction.points.len() + 1),
        observation_image: Vec::with_capacity(total),
        observation_px: Vec::with_capacity(total),
        loss: Loss::Squared,
        depth: None,
    };
    problem.track_start.push(0);
    for point in &reconstruction.points {
        for o in &point.observations {
            let px = reconstruction.images[o.image as usize].keypoints_px[o.keypoint as usize];
            // A model may hold keypoints that are no numbers; they say nothing about the scene.
            if px.is_finite() {
                problem.observation_image.push(o.image);
                problem.observation_px.push(px);
            }
        }
        problem.track_start.push(problem.observation_px.len() as u32);
    }
    Ok(problem)
}

/// Focal lengths and distortion, as COLMAP's bundle adjustment moves them by default.
fn moving(camera: &Camera, intrinsics: BundleIntrinsics) -> [bool; MAX_PARAMS] {
    let mut moving = [false; MAX_PARAMS];
    if intrinsics == BundleIntrinsics::Refine {
        for &index in camera.model.focal_params().iter().chain(camera.model.extra_params()) {
            moving[index] = true;
        }
    }
    moving
}

/// Writes the state of the problem into the model it came from, with the points' errors.
pub(super) fn apply(problem: &Problem, reconstruction: &mut Reconstruction) {
    for (image, pose) in reconstruction.images.iter_mut().zip(&problem.cam_from_world) {
        image.cam_from_world = *pose;
    }
    for (point, position) in reconstruction.points.iter_mut().zip(&problem.points) {
        point.position = *position;
    }
    reconstruction.cameras.clone_from(&problem.cameras);
    update_point_errors(reconstruction);
}
