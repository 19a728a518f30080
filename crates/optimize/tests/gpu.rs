//! Whole solves on a WebGPU device (lavapipe where there is no GPU) against the optima that `f64` finds.
#![cfg(feature = "gpu")]

mod common;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::CameraModel;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{self, Options, ParamPrior, PoseFreedom, Problem};
use epipole_optimize::gpu::{Device, GpuError, Limits};
use epipole_optimize::lm::{IterationRecord, LmOptions, LmReport, Observer, Termination};
use epipole_optimize::{Loss, OptimizeError};
use glam::{DVec2, DVec3};
use pollster::block_on;

/// A device under WebGPU's default limits, or `None` with a loud line.
fn device() -> Option<Device> {
    match block_on(Device::open(Limits::Default)) {
        Ok(device) => {
            println!("on {}", device.description());
            Some(device)
        }
        Err(error @ GpuError::NoAdapter { .. }) => {
            println!("SKIPPED, nothing was tested: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn tight(activation: Activation) -> Options {
    let lm = LmOptions { max_iterations: 60, relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
    Options { lm, activation, ..Options::default() }
}

fn on_gpu(device: &Device, problem: &mut Problem, options: &Options) -> LmReport {
    let report = block_on(bundle::gpu::solve(device, problem, options, &mut ())).expect("a good problem");
    println!(
        "{:.7e}, {} iterations, {} rejected, {} products, {:?}",
        report.final_cost, report.iterations, report.rejected, report.inner_iterations, report.termination
    );
    report
}

/// The cost that `f64` reaches on the CPU.
fn optimum(problem: &Problem, options: &Options) -> f64 {
    let lm = LmOptions { max_iterations: 200, relative_decrease_tolerance: 1e-9, ..options.lm };
    bundle::solve(&mut problem.clone(), &Options { lm, ..*options }, &mut ()).expect("a good problem").final_cost
}

#[test]
fn reaches_the_known_optima_of_bal() {
    let Some(device) = device() else { return };
    for (name, optimum) in [("problem-49-7776-pre.txt", 1.334424e4), ("problem-21-11315-pre.txt", 3.037864e4)] {
        let Some(mut problem) = common::read_bal(name) else { return };
        let report = on_gpu(&device, &mut problem, &tight(Activation::All));
        let gap = report.final_cost / optimum - 1.0;
        println!("{name}: gap {gap:.1e}");
        assert!(gap.abs() < 1e-5, "{name}: {gap}");
        for record in report.history.iter().filter(|r| !r.accepted) {
            let gap = record.cost / optimum - 1.0;
            assert!(gap < 1e-5, "refused at a gap of {gap}: {record:?}");
        }
    }
}

#[test]
fn loses_nothing_far_from_the_origin() {
    let Some(device) = device() else { return };
    let Some(mut problem) = common::read_bal("problem-21-11315-pre.txt") else { return };
    let shift = DVec3::new(1e5, -1e5, 1e5);
    problem.points.iter_mut().for_each(|p| *p += shift);
    for pose in &mut problem.cam_from_world {
        *pose = Rigid3::from_rotation_and_center(pose.rotation, pose.center() + shift);
    }
    let gap = on_gpu(&device, &mut problem, &tight(Activation::All)).final_cost / 3.037864e4 - 1.0;
    assert!(gap.abs() < 1e-5, "{gap}");
}

#[test]
fn reaches_the_optimum_of_f64_for_every_model_loss_and_way_of_sharing() {
    let Some(device) = device() else { return };
    // 40 images of one camera take the tree over images; 12 images the short sum.
    let scenes = [
        (CameraModel::SimplePinhole, vec![900.0, 500.0, 500.0], true, vec![0], 12, Loss::Squared),
        (CameraModel::Pinhole, vec![900.0, 880.0, 500.0, 500.0], false, vec![0, 1], 12, Loss::Huber(1.0)),
        (CameraModel::SimpleRadial, vec![900.0, 500.0, 500.0, 0.05], true, vec![0, 3], 40, Loss::Cauchy(1.0)),
        (CameraModel::Radial, vec![900.0, 500.0, 500.0, 0.05, -0.02], false, vec![], 12, Loss::Squared),
        (
            CameraModel::OpenCv,
            vec![900.0, 880.0, 500.0, 500.0, 0.05, -0.02, 1e-3, -2e-3],
            true,
            vec![0, 1, 4, 5, 6, 7],
            40,
            Loss::Huber(1.0),
        ),
    ];
    for (model, params, shared, refine, images, loss) in scenes {
        let scene = common::Scene { images, model, params, shared, refine, ..common::Scene::default() };
        let mut problem = common::ring(&scene);
        common::perturb(&mut problem, 0.3, 0.02, 3);
        problem.loss = loss;
        let options = tight(Activation::ValidAtStart);
        let optimum = optimum(&problem, &options);
        let found = on_gpu(&device, &mut problem, &options).final_cost;
        assert!((found / optimum - 1.0).abs() < 1e-5, "{model:?}: {found} against {optimum}");
    }
}

#[test]
fn constant_poses_points_and_parameters_stay_and_one_image_points_keep_their_value() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene::default());
    problem.pose_freedom[0] = PoseFreedom::Fixed;
    problem.pose_freedom[1] = PoseFreedom::RotationFixed;
    common::perturb(&mut problem, 0.3, 0.02, 3);
    // A point that one image sees, and an image that sees nothing but that.
    problem.points.push(DVec3::new(0.1, 0.2, 0.3));
    problem.cam_from_world.push(problem.cam_from_world[0]);
    problem.image_camera.push(0);
    problem.pose_freedom.push(PoseFreedom::Free);
    problem.observation_image.push(12);
    problem.observation_px.push(DVec2::new(400.0, 400.0));
    problem.track_start.push(problem.observation_image.len() as u32);
    let before = problem.clone();
    let options = tight(Activation::ValidAtStart);
    let optimum = optimum(&problem, &options);
    let found = on_gpu(&device, &mut problem, &options).final_cost;
    assert!((found / optimum - 1.0).abs() < 1e-5, "{found} against {optimum}");
    assert_eq!(problem.cam_from_world[0], before.cam_from_world[0]);
    assert_eq!(problem.cam_from_world[1].rotation, before.cam_from_world[1].rotation);
    assert!(problem.cam_from_world[1].center() != before.cam_from_world[1].center());
    assert_eq!(problem.cameras[0].params[1..3], before.cameras[0].params[1..3]);
    assert_eq!(problem.points.last(), before.points.last());
    let idle = (problem.cam_from_world[12].center() - before.cam_from_world[12].center()).length();
    assert!(idle < 1e-6, "{idle}");
}

#[test]
fn the_same_problem_gives_the_same_bytes() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene::default());
    common::perturb(&mut problem, 0.3, 0.02, 3);
    let mut again = problem.clone();
    let options = tight(Activation::ValidAtStart);
    assert_eq!(on_gpu(&device, &mut problem, &options), on_gpu(&device, &mut again, &options));
    assert_eq!((problem.points, problem.cam_from_world), (again.points, again.cam_from_world));
}

/// Destroys the device after a few iterations.
struct Saboteur<'a>(&'a Device);

impl Observer for Saboteur<'_> {
    fn iteration(&mut self, record: &IterationRecord) {
        if record.iteration == 3 {
            self.0.destroy();
        }
    }
}

#[test]
fn a_device_lost_on_the_way_is_an_error_and_the_problem_can_be_solved_elsewhere() {
    let (Some(lost), Some(next)) = (device(), device()) else { return };
    let mut problem = common::ring(&common::Scene::default());
    common::perturb(&mut problem, 0.3, 0.02, 3);
    let before = problem.clone();
    let options = tight(Activation::ValidAtStart);
    let result = block_on(bundle::gpu::solve(&lost, &mut problem, &options, &mut Saboteur(&lost)));
    assert!(matches!(result, Err(OptimizeError::Gpu(GpuError::Lost { .. }))), "{result:?}");
    assert_eq!(problem.points, before.points);
    let found = on_gpu(&next, &mut problem, &options).final_cost;
    assert!((found / optimum(&before, &options) - 1.0).abs() < 1e-5);
}

#[test]
fn what_the_kernels_do_not_cover_is_an_error() {
    let Some(device) = device() else { return };
    let solve =
        |problem: &mut Problem, activation| block_on(bundle::gpu::solve(&device, problem, &tight(activation), &mut ()));
    let unsupported = |result| matches!(result, Err(OptimizeError::Gpu(GpuError::Unsupported { .. })));
    let good = common::ring(&common::Scene::default());
    assert!(unsupported(solve(&mut good.clone(), Activation::Truncated { residual_limit_px: 8.0 })));
    let mut prior = good.clone();
    prior.param_priors[0].push(ParamPrior { index: 0, mean: 900.0, sigma: 10.0 });
    assert!(unsupported(solve(&mut prior, Activation::All)));
    let mut fisheye = good.clone();
    fisheye.cameras[0] = common::camera(0, CameraModel::SimpleFisheye, vec![900.0, 500.0, 500.0]);
    assert!(unsupported(solve(&mut fisheye, Activation::All)));
    let mut empty = Problem { track_start: vec![0], ..Problem::default() };
    let report = solve(&mut empty, Activation::All).expect("nothing is no error");
    assert_eq!(report.termination, Termination::NothingToSolve);
}
