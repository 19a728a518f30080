//! Every kernel of a step on a device against its twins, each from the device's own state before it.

use epipole_geometry::camera::CameraModel;
use glam::{DVec2, DVec3};
use pollster::block_on;

use super::bench::Bench;
use super::check_linear::{check_linearization, check_preconditioner};
use super::check_step::{check_cameras, check_pcg, check_trial};
use crate::bundle::gpu::{GpuSystem, Residency};
use crate::bundle::{Options, ParamPrior, PoseFreedom, Problem};
use crate::common_for_tests as common;
use crate::gpu::Device;
use crate::gpu::tests::device;
use crate::lm::System;
use crate::loss::Loss;

pub(super) fn check(device: &Device, problem: &Problem) {
    for residency in [Residency::default(), Residency { chunk_observations: 1000 }] {
        check_in_chunks(device, problem, &residency);
    }
}

fn check_in_chunks(device: &Device, problem: &Problem, residency: &Residency) {
    let options = Options::default();
    let mut system = GpuSystem::with_residency(device, problem, &options, residency).expect("a good problem");
    assert_eq!(system.layout.chunks.len() == 1, *residency == Residency::default());
    system.resident.params.lambda = 1e-4;
    system.resident.write_params(device);
    let bench = Bench { system };
    check_linearization(&bench);
    check_preconditioner(&bench);
    check_pcg(&bench);
    check_cameras(&bench);
    check_trial(&bench);
}

#[test]
fn kernels_agree_with_their_twins_on_many_small_cameras() {
    let Some(device) = device() else { return };
    let params = vec![900.0, 880.0, 500.0, 500.0, 0.05, -0.02, 1e-3, -2e-3];
    let refine = vec![0, 1, 4, 5, 6, 7];
    let scene = common::Scene { model: CameraModel::OpenCv, params, refine, shared: false, ..common::Scene::default() };
    let mut problem = common::ring(&scene);
    common::perturb(&mut problem, 0.3, 0.02, 3);
    problem.loss = Loss::Huber(1.0);
    problem.param_priors[1].push(ParamPrior { index: 0, mean: 905.0, sigma: 2.0 });
    problem.param_priors[1].push(ParamPrior { index: 5, mean: 0.01, sigma: 0.1 });
    problem.pose_freedom[2] = PoseFreedom::RotationFixed;
    // An image without observations, a point seen once, and one behind everything that sees it.
    problem.cam_from_world.push(problem.cam_from_world[0]);
    problem.image_camera.push(0);
    problem.pose_freedom.push(PoseFreedom::Free);
    problem.points.push(DVec3::ZERO);
    problem.observation_image.push(1);
    problem.observation_px.push(DVec2::splat(500.0));
    problem.track_start.push(problem.observation_image.len() as u32);
    problem.points.push(problem.cam_from_world[0].center() * 40.0);
    problem.observation_image.extend([0, 0, 1]);
    problem.observation_px.extend([DVec2::splat(500.0); 3]);
    problem.track_start.push(problem.observation_image.len() as u32);
    check(&device, &problem);
}

#[test]
fn kernels_agree_with_their_twins_on_mixed_cameras() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene { images: 24, shared: false, ..common::Scene::default() });
    common::mix_models(&mut problem, |_, _| true);
    common::perturb(&mut problem, 0.3, 0.02, 3);
    problem.loss = Loss::Huber(1.0);
    check(&device, &problem);
}

#[test]
fn kernels_agree_with_their_twins_under_a_bounded_loss() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene::default());
    common::perturb(&mut problem, 0.3, 0.02, 3);
    // From far inside the bound to far beyond it.
    problem.observation_px.iter_mut().step_by(9).for_each(|px| px.x += 200.0);
    for scale in [0.5, 8.0, 1e3] {
        problem.loss = Loss::GemanMcClure(scale);
        check(&device, &problem);
    }
}

/// One workgroup takes all images, however many: 4 200 with a camera of their own, and 4 200 that share one.
#[test]
fn pcg_agrees_with_its_twins_on_thousands_of_images() {
    let Some(device) = device() else { return };
    for shared in [false, true] {
        let scene =
            common::Scene { images: 4200, points: 3000, track: 4, band: 30, shared, ..common::Scene::default() };
        let mut problem = common::ring(&scene);
        common::perturb(&mut problem, 0.1, 0.01, 3);
        let mut system = GpuSystem::new(&device, &problem, &Options::default()).expect("a good problem");
        block_on(async {
            system.refresh(&mut ()).await;
            system.linearize(&mut ()).await;
            system.queue_start(1e-3, &mut ()).await.expect("a live device");
        });
        let bench = Bench { system };
        assert!(bench.units() > 4096);
        check_pcg(&bench);
    }
}

#[test]
fn kernels_agree_with_their_twins_on_large_cameras_and_long_tracks() {
    let Some(device) = device() else { return };
    let scene = common::Scene { images: 40, points: 800, track: 8, band: 40, ..common::Scene::default() };
    let mut problem = common::ring(&scene);
    // One camera with 10 000 observations in all, one track of 500 (images see it more than once).
    for p in 0..10_000 {
        let point = problem.points[p % 800] * 0.9;
        problem.points.push(point);
        for image in [7, 7 + 1 + p as u32 % 30] {
            let pose = problem.cam_from_world[image as usize];
            let px = problem.cameras[0].project(pose.transform_point(point)).expect("in front of the ring");
            problem.observation_image.push(image);
            problem.observation_px.push(px + DVec2::new(0.3, -0.2));
        }
        problem.track_start.push(problem.observation_image.len() as u32);
    }
    problem.points.push(DVec3::new(0.1, 0.2, -0.1));
    for k in 0..500 {
        let pose = problem.cam_from_world[k % 40];
        let px = problem.cameras[0].project(pose.transform_point(DVec3::new(0.1, 0.2, -0.1)));
        problem.observation_image.push(k as u32 % 40);
        problem.observation_px.push(px.expect("in front of the ring") + DVec2::new(0.1 * (k % 7) as f64, 0.0));
    }
    problem.track_start.push(problem.observation_image.len() as u32);
    common::perturb(&mut problem, 0.1, 0.01, 3);
    problem.loss = Loss::Cauchy(2.0);
    problem.param_priors[0].push(ParamPrior { index: 0, mean: 870.0, sigma: 0.5 });
    check(&device, &problem);
}
