//! A scene as a "bundle adjustment in the large" problem (Agarwal et al., ECCV 2010), moved away from its optimum.

use std::path::Path;

use epipole_formats::bal::{self, BalProblem};
use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::Image;
use glam::{DQuat, DVec2, DVec3};

use super::random::{Random, Stream};
use super::{Scene, SynthError};

/// How far the written start is from the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalPerturbation {
    /// Standard deviation per axis of the rotations, degrees.
    pub rotation_deg: f64,
    /// Standard deviation per axis of camera centres and points, metres.
    pub position: f64,
    /// Standard deviation of the focal lengths, relative.
    pub focal_relative: f64,
    /// Everything random follows from it.
    pub seed: u64,
}

impl Default for BalPerturbation {
    fn default() -> Self {
        // What a rough initialisation leaves: convergence takes several steps and ends in the right basin.
        Self { rotation_deg: 0.5, position: 0.03, focal_relative: 0.01, seed: 0 }
    }
}

/// The truth's observations with a perturbed start.
///
/// BAL's camera looks along −Z with y up and its pixel origin in the image's middle; its projection is
/// `f (1 + k1 r² + k2 r⁴) p` with one camera per image.
///
/// # Errors
/// [`SynthError::InvalidOption`] for camera models that BAL cannot express.
pub fn bal_problem(scene: &Scene, perturbation: &BalPerturbation) -> Result<BalProblem, SynthError> {
    let mut random = Random::new(perturbation.seed, Stream::Perturbation);
    let truth = &scene.truth;
    let mut problem = BalProblem::default();
    for image in &truth.images {
        problem.cameras.push(perturbed(image, &truth.cameras[image.camera], perturbation, &mut random)?);
    }
    for (p, point) in truth.points.iter().enumerate() {
        problem.points.push(point.position + random.gaussian3(perturbation.position));
        for o in &point.observations {
            let image = &truth.images[o.image as usize];
            let from_center =
                image.keypoints_px[o.keypoint as usize] - truth.cameras[image.camera].principal_point_px();
            // The y axis turns round; the keypoint is an f32, and so stays short in the file.
            problem.observations.push((o.image, p as u32, DVec2::new(from_center.x, -from_center.y)));
        }
    }
    Ok(problem)
}

/// Writes [`bal_problem`] to a file.
///
/// # Errors
/// As [`bal_problem`], and [`SynthError::Format`] for the file system.
pub fn write_bal(scene: &Scene, perturbation: &BalPerturbation, path: &Path) -> Result<(), SynthError> {
    Ok(bal::write_bal(path, &bal_problem(scene, perturbation)?)?)
}

fn perturbed(
    image: &Image,
    camera: &Camera,
    perturbation: &BalPerturbation,
    random: &mut Random,
) -> Result<[f64; 9], SynthError> {
    let [focal_px, k1, k2] = radial(camera)?;
    let turn = DQuat::from_scaled_axis(random.gaussian3(perturbation.rotation_deg.to_radians()));
    let center = image.cam_from_world.center() + random.gaussian3(perturbation.position);
    let cam_from_world = Rigid3::from_rotation_and_center(turn * image.cam_from_world.rotation, center);
    // Half a turn about x takes (right, down, forward) to (right, up, backward).
    let bal_from_cam = Rigid3::new(DQuat::from_rotation_x(std::f64::consts::PI), DVec3::ZERO);
    let bal_from_world = bal_from_cam * cam_from_world;
    let rotation = bal_from_world.rotation.to_scaled_axis();
    let translation = bal_from_world.translation;
    let focal_px = focal_px * (1.0 + perturbation.focal_relative * random.gaussian());
    Ok([rotation.x, rotation.y, rotation.z, translation.x, translation.y, translation.z, focal_px, k1, k2])
}

/// Focal length, k1 and k2.
fn radial(camera: &Camera) -> Result<[f64; 3], SynthError> {
    let p = &camera.params;
    match camera.model {
        CameraModel::SimplePinhole => Ok([p[0], 0.0, 0.0]),
        CameraModel::SimpleRadial => Ok([p[0], p[3], 0.0]),
        CameraModel::Radial => Ok([p[0], p[3], p[4]]),
        other => Err(SynthError::InvalidOption {
            name: "models",
            value: other.name().into(),
            expected: "BAL files hold SIMPLE_PINHOLE, SIMPLE_RADIAL and RADIAL cameras only",
        }),
    }
}
