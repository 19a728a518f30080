//! Bundle adjustment of synthetic scenes with known truth: exactness, agreement of solvers and scalars, constraints,
//! determinism and bad input.

mod common;

use common::{Scene, perturb, ring};
use epipole_geometry::camera::CameraModel;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{self, Options, ParamPrior, PoseFreedom, Problem, Solver};
use epipole_optimize::lm::{LmOptions, LmReport, Observer, Termination};
use epipole_optimize::{Loss, OptimizeError};
use glam::{DVec2, DVec3};

fn tight(solver: Solver) -> Options {
    let lm = LmOptions { max_iterations: 100, relative_decrease_tolerance: 1e-10, ..LmOptions::default() };
    Options { lm, solver, ..Options::default() }
}

fn solve(problem: &mut Problem, options: &Options) -> LmReport {
    bundle::solve(problem, options, &mut ()).expect("a good problem")
}

fn assert_monotone(report: &LmReport) {
    let mut last = report.initial_cost;
    for record in &report.history {
        assert!(record.cost <= last * (1.0 + 1e-12), "cost rose: {record:?}");
        last = record.cost;
    }
}

#[test]
fn without_noise_the_cost_vanishes_for_every_model() {
    let models: [(CameraModel, &[f64], &[usize]); 6] = [
        (CameraModel::SimplePinhole, &[900.0, 500.0, 500.0], &[0]),
        (CameraModel::Pinhole, &[900.0, 910.0, 500.0, 490.0], &[0, 1, 2, 3]),
        (CameraModel::Radial, &[900.0, 500.0, 500.0, 0.05, -0.01], &[0, 3, 4]),
        (CameraModel::OpenCv, &[900.0, 905.0, 500.0, 500.0, 0.05, -0.01, 0.001, 0.002], &[0, 1, 4, 5, 6, 7]),
        (CameraModel::OpenCvFisheye, &[600.0, 600.0, 500.0, 500.0, 0.02, -0.01, 0.0, 0.0], &[0, 1, 4, 5]),
        (CameraModel::Equirectangular, &[2000.0, 1000.0], &[]),
    ];
    for (model, params, refine) in models {
        for shared in [true, false] {
            let scene = Scene {
                model,
                params: params.to_vec(),
                refine: refine.to_vec(),
                noise_px: 0.0,
                shared,
                points: 150,
                ..Scene::default()
            };
            let truth = ring(&scene);
            let mut problem = truth.clone();
            perturb(&mut problem, 0.3, 0.02, 3);
            for camera in &mut problem.cameras {
                for &k in refine {
                    camera.params[k] = camera.params[k] * 1.01 + 1e-3;
                }
            }
            let report = solve(&mut problem, &tight(Solver::Auto));
            assert!(report.final_cost < 1e-10 && report.initial_cost > 100.0, "{model:?} {shared} {report:?}");
            // Cameras on a turntable leave the ratio of two focal lengths open.
            if model.num_params() == 4 || model.num_params() == 8 {
                continue;
            }
            for (camera, truth) in problem.cameras.iter().zip(&truth.cameras) {
                for (a, b) in camera.params.iter().zip(&truth.params) {
                    assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{model:?}: {:?}", camera.params);
                }
            }
        }
    }
}

#[test]
fn all_solvers_and_scalars_find_the_same_optimum() {
    for (shared, loss) in
        [(true, Loss::Squared), (false, Loss::Squared), (true, Loss::Huber(1.0)), (true, Loss::Cauchy(1.0))]
    {
        let mut start = ring(&Scene { shared, ..Scene::default() });
        start.loss = loss;
        for px in start.observation_px.iter_mut().step_by(37) {
            *px += DVec2::new(25.0, -10.0);
        }
        perturb(&mut start, 0.3, 0.02, 3);
        let reference = solve(&mut start.clone(), &tight(Solver::Cholesky));
        assert_monotone(&reference);
        for solver in [Solver::PcgExplicit, Solver::PcgImplicit] {
            let mut options = tight(solver);
            options.pcg.eta = 0.01;
            let report = solve(&mut start.clone(), &options);
            let gap = report.final_cost / reference.final_cost - 1.0;
            assert!(gap.abs() < 1e-6, "{solver:?} {loss:?}: {gap}");
        }
        for solver in [Solver::Cholesky, Solver::PcgImplicit] {
            let mut options = tight(solver);
            options.lm.relative_decrease_tolerance = 1e-7;
            let report = bundle::solve_with::<f32>(&mut start.clone(), &options, &mut ()).expect("a good problem");
            let gap = report.final_cost / reference.final_cost - 1.0;
            assert!(gap.abs() < 1e-5, "f32 {solver:?} {loss:?}: {gap}");
        }
    }
}

#[test]
fn a_far_origin_changes_nothing() {
    let cost = |offset: DVec3, single: bool| {
        let mut problem = ring(&Scene { offset, ..Scene::default() });
        perturb(&mut problem, 0.3, 0.02, 3);
        let mut options = tight(Solver::Cholesky);
        options.lm.relative_decrease_tolerance = 1e-8;
        let report = match single {
            true => bundle::solve_with::<f32>(&mut problem, &options, &mut ()),
            false => bundle::solve(&mut problem, &options, &mut ()),
        };
        report.expect("a good problem").final_cost
    };
    let here = cost(DVec3::ZERO, false);
    let far = DVec3::new(1e5, -2e5, 3e5);
    assert!((cost(far, false) / here - 1.0).abs() < 1e-7);
    assert!((cost(far, true) / here - 1.0).abs() < 1e-5);
}

#[test]
fn what_is_fixed_stays_and_priors_pull() {
    let mut start = ring(&Scene::default());
    start.pose_freedom[0] = PoseFreedom::Fixed;
    start.pose_freedom[1] = PoseFreedom::RotationFixed;
    perturb(&mut start, 0.2, 0.02, 3);
    start.cameras[0].params[0] = 905.0;
    let mut problem = start.clone();
    let free = solve(&mut problem, &tight(Solver::Cholesky));
    assert_eq!(problem.cam_from_world[0], start.cam_from_world[0]);
    assert_eq!(problem.cam_from_world[1].rotation, start.cam_from_world[1].rotation);
    assert_ne!(problem.cam_from_world[1].center(), start.cam_from_world[1].center());
    assert_ne!(problem.cameras[0].params[0], 905.0);
    assert_eq!(problem.cameras[0].params[1..3], start.cameras[0].params[1..3]);

    let mut bound = start.clone();
    bound.param_priors[0].push(ParamPrior { index: 0, mean: 905.0, sigma: 1e-6 });
    let report = solve(&mut bound, &tight(Solver::Cholesky));
    assert!((bound.cameras[0].params[0] - 905.0).abs() < 1e-6, "{:?}", bound.cameras[0].params);
    assert!(report.final_cost > free.final_cost);
    assert_monotone(&report);

    let mut loose = start.clone();
    loose.param_priors[0].push(ParamPrior { index: 0, mean: 950.0, sigma: 1e6 });
    let report = solve(&mut loose, &tight(Solver::PcgImplicit));
    assert!((report.final_cost / free.final_cost - 1.0).abs() < 1e-6);
}

#[test]
fn constant_points_or_constant_cameras_are_solved_too() {
    let truth = ring(&Scene { noise_px: 0.0, ..Scene::default() });
    let mut resection = truth.clone();
    resection.fixed_points = true;
    perturb(&mut resection, 0.5, 0.05, 3);
    let report = solve(&mut resection, &tight(Solver::Auto));
    assert!(report.final_cost < 1e-12, "{report:?}");
    for (pose, truth) in resection.cam_from_world.iter().zip(&truth.cam_from_world) {
        assert!((pose.center() - truth.center()).length() < 1e-7);
    }

    let mut intersection = truth.clone();
    intersection.pose_freedom.fill(PoseFreedom::Fixed);
    intersection.refine_params[0].fill(false);
    perturb(&mut intersection, 0.0, 0.1, 3);
    let report = solve(&mut intersection, &tight(Solver::Auto));
    assert!(report.final_cost < 1e-12 && report.initial_cost > 1.0, "{report:?}");
    for (point, truth) in intersection.points.iter().zip(&truth.points) {
        assert!((*point - *truth).length() < 1e-7);
    }
    assert_eq!(intersection.cam_from_world, truth.cam_from_world);
}

#[test]
fn the_objective_never_rises_with_points_behind_cameras() {
    for activation in [Activation::ValidAtStart, Activation::Truncated { residual_limit_px: 60.0 }, Activation::DYNAMIC]
    {
        let mut problem = ring(&Scene { points: 200, ..Scene::default() });
        perturb(&mut problem, 1.0, 0.05, 3);
        // Some points behind the cameras, some in the middle of a camera, some observations far off.
        for k in (0..problem.points.len()).step_by(17) {
            let image = problem.observation_image[problem.track_start[k] as usize] as usize;
            problem.points[k] = problem.cam_from_world[image].center() * if k % 2 == 0 { 1.5 } else { 0.999 };
        }
        for px in problem.observation_px.iter_mut().step_by(41) {
            *px += DVec2::splat(500.0);
        }
        let mut options = tight(Solver::Cholesky);
        options.activation = activation;
        for single in [false, true] {
            let mut problem = problem.clone();
            let report = match single {
                true => bundle::solve_with::<f32>(&mut problem, &options, &mut ()),
                false => bundle::solve(&mut problem, &options, &mut ()),
            };
            let report = report.expect("a good problem");
            let slack = if single { 1e-6 } else { 1e-12 };
            let mut last = report.initial_cost;
            for record in &report.history {
                assert!(record.cost <= last * (1.0 + slack), "{activation:?} {single}: {record:?}");
                last = record.cost;
            }
            assert!(report.accepted > 2 && report.active < problem.observation_px.len(), "{report:?}");
            assert!(problem.points.iter().all(|p| p.is_finite()));
        }
    }
}

#[test]
fn a_point_twice_in_one_image_counts_twice() {
    let mut problem = ring(&Scene { points: 100, ..Scene::default() });
    // Every third track sees its first image again, a little elsewhere.
    let (mut image, mut px, mut start) = (Vec::new(), Vec::new(), vec![0]);
    for p in 0..problem.points.len() {
        let range = problem.track_start[p] as usize..problem.track_start[p + 1] as usize;
        image.extend_from_slice(&problem.observation_image[range.clone()]);
        px.extend_from_slice(&problem.observation_px[range.clone()]);
        if p % 3 == 0 {
            image.push(problem.observation_image[range.start]);
            px.push(problem.observation_px[range.start] + DVec2::new(0.7, -0.3));
        }
        start.push(image.len() as u32);
    }
    (problem.observation_image, problem.observation_px, problem.track_start) = (image, px, start);
    perturb(&mut problem, 0.3, 0.02, 3);
    let exact = solve(&mut problem.clone(), &tight(Solver::Cholesky));
    let report = solve(&mut problem.clone(), &tight(Solver::PcgImplicit));
    assert!((report.final_cost / exact.final_cost - 1.0).abs() < 1e-6);
    // Steps of a correct system keep their promise near the optimum (later ones are down to rounding).
    assert!((exact.history[1].gain - 1.0).abs() < 0.1, "{exact:?}");
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    let mut start = ring(&Scene { images: 70, points: 1500, band: 9, ..Scene::default() });
    start.loss = Loss::Huber(1.0);
    perturb(&mut start, 0.3, 0.02, 3);
    for solver in [Solver::Cholesky, Solver::PcgImplicit] {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let mut problem = start.clone();
            let options = Options { solver, ..Options::default() };
            let report = pool.install(|| solve(&mut problem, &options));
            (format!("{:?}", (problem.cam_from_world, problem.points, problem.cameras)), report.final_cost.to_bits())
        };
        assert_eq!(run(1), run(2));
        assert_eq!(run(1), run(3));
    }
}

#[test]
fn poor_problems_do_not_panic() {
    let empty = Problem { track_start: vec![0], ..Problem::default() };
    assert_eq!(solve(&mut empty.clone(), &Options::default()).termination, Termination::NothingToSolve);

    let mut problem = ring(&Scene { points: 60, ..Scene::default() });
    // A camera with one observation, one with none, points with one and none.
    problem.cam_from_world.push(problem.cam_from_world[0]);
    problem.cam_from_world.push(problem.cam_from_world[1]);
    problem.image_camera.extend([0, 0]);
    problem.pose_freedom.extend([PoseFreedom::Free; 2]);
    problem.points.extend([DVec3::ZERO, DVec3::X]);
    problem.observation_image.push(12);
    problem.observation_px.push(DVec2::new(500.0, 400.0));
    let end = problem.observation_px.len() as u32;
    problem.track_start.extend([end, end]);
    perturb(&mut problem, 0.2, 0.01, 3);
    let before = problem.clone();
    for solver in [Solver::Auto, Solver::PcgImplicit, Solver::PcgExplicit] {
        let mut problem = before.clone();
        let report = solve(&mut problem, &tight(solver));
        assert!(report.final_cost < report.initial_cost);
        assert_eq!(problem.points[60..], before.points[60..]);
        for i in [12, 13] {
            assert!((problem.cam_from_world[i].center() - before.cam_from_world[i].center()).length() < 1e-12);
        }
    }

    let mut flat = ring(&Scene { points: 60, ..Scene::default() });
    flat.points.fill(flat.cam_from_world[0].center());
    solve(&mut flat, &Options::default());
}

#[test]
fn malformed_problems_are_named() {
    let good = ring(&Scene { points: 20, ..Scene::default() });
    let error = |change: &dyn Fn(&mut Problem)| {
        let mut problem = good.clone();
        change(&mut problem);
        bundle::solve(&mut problem, &Options::default(), &mut ()).expect_err("a bad problem")
    };
    let array = |e: &OptimizeError| match e {
        OptimizeError::Length { array, .. }
        | OptimizeError::Index { array, .. }
        | OptimizeError::Value { array, .. } => *array,
        _ => "",
    };
    assert_eq!(array(&error(&|p| p.points[3].x = f64::NAN)), "points");
    assert_eq!(array(&error(&|p| p.observation_px[3].y = f64::INFINITY)), "observation_px");
    assert_eq!(array(&error(&|p| p.observation_image[5] = 99)), "observation_image");
    assert_eq!(array(&error(&|p| p.image_camera[2] = 7)), "image_camera");
    assert_eq!(array(&error(&|p| p.track_start[4] = 0)), "track_start");
    assert_eq!(array(&error(&|p| p.track_start.clear())), "track_start");
    assert_eq!(array(&error(&|p| p.cameras[0].params.clear())), "cameras");
    assert_eq!(array(&error(&|p| p.cam_from_world[0].translation.x = f64::NAN)), "cam_from_world");
    assert_eq!(array(&error(&|p| p.loss = Loss::Huber(0.0))), "loss");
    assert_eq!(
        array(&error(&|p| p.param_priors[0].push(ParamPrior { index: 9, mean: 0.0, sigma: 1.0 }))),
        "param_priors"
    );
}

#[test]
fn an_observer_can_stop_and_keeps_the_last_accepted_state() {
    struct Stop(usize);
    impl Observer for Stop {
        fn iteration(&mut self, _: &epipole_optimize::lm::IterationRecord) {
            self.0 += 1;
        }
        fn should_stop(&self) -> bool {
            self.0 >= 2
        }
    }
    let mut problem = ring(&Scene::default());
    perturb(&mut problem, 0.3, 0.02, 3);
    let report = bundle::solve(&mut problem, &Options::default(), &mut Stop(0)).expect("a good problem");
    assert_eq!((report.termination, report.iterations), (Termination::Stopped, 2));
    // The written state is the accepted one: a new solve starts from its cost.
    let again = solve(&mut problem, &Options::default());
    assert!((again.initial_cost / report.final_cost - 1.0).abs() < 1e-9);
}
