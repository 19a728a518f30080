//! Depths of scenes with known truth, and the scale that comes of them.

#![allow(dead_code, unreachable_pub)]

use epipole_geometry::Similarity3;
use epipole_geometry::camera::CameraModel;
use epipole_optimize::bundle::{Depth, Problem};
use glam::{DQuat, DVec3};

use super::Scene;

/// The z-depth of every `every`-th observation at the problem's state, times `factor(k)`, with a relative sigma of 5 %.
pub fn depths(truth: &Problem, every: usize, factor: impl Fn(usize) -> f64) -> Depth {
    let mut depth = Depth::unknown(truth.observation_image.len());
    for p in 0..truth.points.len() {
        for o in truth.track_start[p] as usize..truth.track_start[p + 1] as usize {
            let pose = &truth.cam_from_world[truth.observation_image[o] as usize];
            let z = pose.transform_point(truth.points[p]).z;
            if o % every == 0 {
                depth.set(o, z * factor(o / every), 0.05);
            }
        }
    }
    depth
}

pub fn resize(problem: &mut Problem, scale: f64) {
    let motion = Similarity3 { scale, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };
    for pose in &mut problem.cam_from_world {
        *pose = motion.transform_camera(pose);
    }
    problem.points.iter_mut().for_each(|p| *p = motion.transform_point(*p));
}

/// Mean distance of the centres from their mean, over the same in truth.
pub fn scale(problem: &Problem, truth: &Problem) -> f64 {
    let spread = |problem: &Problem| {
        let centers: Vec<DVec3> = problem.cam_from_world.iter().map(|pose| pose.center()).collect();
        let mean = centers.iter().sum::<DVec3>() / centers.len() as f64;
        centers.iter().map(|c| (*c - mean).length()).sum::<f64>()
    };
    spread(problem) / spread(truth)
}

/// A scene that nearly fills the image of a camera with a field of view of 100°.
pub fn wide() -> Scene {
    let params = vec![420.0, 500.0, 500.0, 0.0];
    Scene { noise_px: 0.0, params, refine: vec![0], model: CameraModel::SimpleRadial, ..Scene::default() }
}

/// Depths of a problem at its truth: up to 5 % off, every seventh of them three times too long. The first points have none,
/// which is a whole chunk where chunks are small; then one point has none, the next every other, the third all. Image 4
/// has none at all, image 5 all it can have.
pub fn uneven_depths(problem: &Problem) -> Depth {
    let mut depth = Depth::unknown(problem.observation_image.len());
    for (p, track) in problem.track_start.windows(2).enumerate() {
        for o in track[0] as usize..track[1] as usize {
            let image = problem.observation_image[o] as usize;
            let sees_depth =
                problem.cameras[problem.image_camera[image] as usize].model != CameraModel::Equirectangular;
            let is_known = match image {
                4 => false,
                5 => true,
                _ => p % 3 == 2 || p % 3 == 1 && o % 2 == 0,
            };
            if sees_depth && is_known && p >= 170 {
                let z = problem.cam_from_world[image].transform_point(problem.points[p]).z;
                let off = 0.95 + 0.02 * (o % 6) as f64;
                depth.set(o, z * if o % 7 == 0 { 3.0 } else { off }, 0.03);
            }
        }
    }
    assert!(depth.is_any());
    depth
}
