//! Synthetic pairs with known truth, shared by the tests of this module.

mod degenerate;
mod estimation;
mod solvers;

use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::Rigid3;
use crate::camera::{Camera, CameraModel};

pub(super) fn pinhole() -> Camera {
    Camera {
        id: 1,
        model: CameraModel::Pinhole,
        width_px: 1600,
        height_px: 1200,
        params: vec![1250.0, 1240.0, 805.0, 590.0],
        has_prior_focal: true,
    }
}

pub(super) fn distorted() -> Camera {
    Camera {
        model: CameraModel::OpenCv,
        params: vec![1250.0, 1240.0, 805.0, 590.0, -0.15, 0.05, 0.002, -0.001],
        ..pinhole()
    }
}

pub(super) fn fisheye() -> Camera {
    Camera {
        model: CameraModel::OpenCvFisheye,
        params: vec![600.0, 600.0, 805.0, 590.0, 0.02, -0.01, 0.001, 0.0],
        ..pinhole()
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Shape {
    Cloud,
    Plane,
}

pub(super) struct Scene {
    pub(super) cam2_from_cam1: Rigid3,
    pub(super) points1: Vec<DVec2>,
    pub(super) points2: Vec<DVec2>,
    pub(super) matches: Vec<[u32; 2]>,
    pub(super) outliers: usize,
}

pub(super) fn gaussian(rng: &mut Pcg32) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(1e-12..1.0), rng.random_range(0.0..1.0));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// `count` matches of which the last `outlier_ratio` are random pairs of pixels.
pub(super) fn scene(
    seed: u64,
    cameras: [&Camera; 2],
    shape: Shape,
    baseline: f64,
    count: usize,
    noise_px: f64,
    outlier_ratio: f64,
) -> Scene {
    let mut rng = Pcg32::seed_from_u64(seed);
    let axis = DVec3::new(gaussian(&mut rng), gaussian(&mut rng), gaussian(&mut rng)).normalize();
    let rotation = DQuat::from_axis_angle(axis, 0.25);
    let direction = DVec3::new(gaussian(&mut rng), 0.3 * gaussian(&mut rng), 0.3 * gaussian(&mut rng)).normalize();
    let cam2_from_cam1 = Rigid3::new(rotation, direction * baseline);
    let size = DVec2::new(cameras[0].width_px as f64, cameras[0].height_px as f64);
    let pixel = |rng: &mut Pcg32| size * DVec2::new(rng.random_range(0.0..1.0), rng.random_range(0.0..1.0));
    let outliers = (count as f64 * outlier_ratio) as usize;
    let (mut points1, mut points2) = (Vec::new(), Vec::new());
    while points1.len() < count - outliers {
        let p = pixel(&mut rng);
        let Some(ray) = cameras[0].ray_from_pixel(p) else { continue };
        if ray.z < 0.2 {
            continue;
        }
        let depth = match shape {
            Shape::Cloud => rng.random_range(4.0..12.0),
            Shape::Plane => 8.0 / (ray / ray.z).dot(DVec3::new(0.3, 0.1, 1.0)),
        };
        let point = ray / ray.z * depth;
        let Some(q) = cameras[1].project(cam2_from_cam1.transform_point(point)) else { continue };
        if q.cmplt(DVec2::ZERO).any() || q.cmpgt(size).any() {
            continue;
        }
        let mut noisy = |x: DVec2| x + noise_px * DVec2::new(gaussian(&mut rng), gaussian(&mut rng));
        points1.push(noisy(p));
        points2.push(noisy(q));
    }
    for _ in 0..outliers {
        points1.push(pixel(&mut rng));
        points2.push(pixel(&mut rng));
    }
    let matches = (0..count as u32).map(|i| [i, i]).collect();
    Scene { cam2_from_cam1, points1, points2, matches, outliers }
}

pub(super) fn rotation_error_rad(a: &Rigid3, b: &Rigid3) -> f64 {
    let d = a.rotation.conjugate() * b.rotation;
    2.0 * d.xyz().length().atan2(d.w.abs())
}

pub(super) fn direction_error_rad(a: &Rigid3, b: &Rigid3) -> f64 {
    a.translation.cross(b.translation).length().atan2(a.translation.dot(b.translation))
}
