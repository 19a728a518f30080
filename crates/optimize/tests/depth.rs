//! Bundle adjustment with metric depth: the scale that it fixes, the rows it must not disturb, the wrong depths it survives.

mod common;

use common::metric::{depths, resize, scale, wide};
use common::{Scene, perturb, ring};
use epipole_geometry::camera::CameraModel;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{self, Depth, Options, PoseFreedom, Problem, Solver};
use epipole_optimize::lm::{LmOptions, LmReport};
use epipole_optimize::{Loss, OptimizeError};

fn tight() -> Options {
    let lm = LmOptions { max_iterations: 100, relative_decrease_tolerance: 1e-12, ..LmOptions::default() };
    Options { lm, ..Options::default() }
}

fn assert_monotone(report: &LmReport) {
    let mut last = report.initial_cost;
    for record in &report.history {
        assert!(record.cost <= last * (1.0 + 1e-12) + 1e-12, "cost rose: {record:?}");
        last = record.cost;
    }
}

#[test]
fn exact_depths_give_the_exact_scale() {
    for solver in [Solver::Cholesky, Solver::PcgImplicit] {
        let truth = ring(&wide());
        let mut start = truth.clone();
        resize(&mut start, 1.1);
        perturb(&mut start, 0.3, 0.02, 5);
        start.depth = Some(depths(&truth, 3, |_| 1.0));
        let mut problem = start.clone();
        let report = bundle::solve(&mut problem, &Options { solver, ..tight() }, &mut ()).expect("a good problem");
        assert_monotone(&report);
        let error = scale(&problem, &truth) - 1.0;
        assert!(error.abs() < 1e-6 && report.final_cost < 1e-8, "{solver:?} {error:e} {report:?}");
        let mut single = start.clone();
        let report = bundle::solve_with::<f32>(&mut single, &Options { solver, ..tight() }, &mut ()).expect("good");
        let error = scale(&single, &truth) - 1.0;
        assert!(error.abs() < 1e-5, "f32 {solver:?} {error:e} {report:?}");
    }
}

#[test]
fn noisy_depths_leave_the_pixels_as_good_as_they_were() {
    let truth = ring(&Scene { noise_px: 0.5, ..wide() });
    let mut free = truth.clone();
    perturb(&mut free, 0.3, 0.02, 5);
    let mut metric = free.clone();
    // ±4 %, alternating.
    metric.depth = Some(depths(&truth, 2, |k| if k % 2 == 0 { 1.04 } else { 0.96 }));
    bundle::solve(&mut free, &tight(), &mut ()).expect("a good problem");
    let both = bundle::solve(&mut metric, &tight(), &mut ()).expect("a good problem");
    assert!((scale(&metric, &truth) - 1.0).abs() < 0.005, "{}", scale(&metric, &truth));
    metric.depth = None;
    let cost = |mut problem: Problem| {
        let lm = LmOptions { max_iterations: 0, ..LmOptions::default() };
        bundle::solve(&mut problem, &Options { lm, ..Options::default() }, &mut ()).expect("good").final_cost
    };
    let (without, with) = (cost(free), cost(metric));
    assert!(with < 1.2 * without && both.final_cost > with, "{without} {with} {}", both.final_cost);
}

#[test]
fn a_wrong_depth_takes_nothing_with_it() {
    let truth = ring(&wide());
    let mut problem = truth.clone();
    perturb(&mut problem, 0.1, 0.01, 5);
    problem.loss = Loss::Huber(1.0);
    // A fifth of the depths is three times too long.
    problem.depth = Some(depths(&truth, 2, |k| if k % 5 == 0 { 3.0 } else { 1.0 }));
    for activation in [Activation::ValidAtStart, Activation::Truncated { residual_limit_px: 16.0 }] {
        let mut problem = problem.clone();
        let options = Options { activation, ..tight() };
        let report = bundle::solve(&mut problem, &options, &mut ()).expect("a good problem");
        assert_monotone(&report);
        assert_eq!(report.active, truth.observation_image.len(), "{activation:?}: pixels are all good");
        assert!((scale(&problem, &truth) - 1.0).abs() < 1e-3, "{activation:?} {}", scale(&problem, &truth));
    }
}

#[test]
fn without_any_valid_depth_nothing_changes() {
    let truth = ring(&Scene { noise_px: 0.5, ..wide() });
    let mut without = truth.clone();
    perturb(&mut without, 0.3, 0.02, 5);
    let mut masked = without.clone();
    masked.depth = Some(Depth::unknown(truth.observation_image.len()));
    bundle::solve(&mut without, &tight(), &mut ()).expect("a good problem");
    bundle::solve(&mut masked, &tight(), &mut ()).expect("a good problem");
    assert_eq!(without.points, masked.points);
    // One depth brings the third row, zero everywhere else: the same answer, as a free scale is free to follow it.
    let mut one = truth.clone();
    perturb(&mut one, 0.3, 0.02, 5);
    let mut depth = Depth::unknown(truth.observation_image.len());
    depth.set(7, 2.0, 0.05);
    one.depth = Some(depth);
    let report = bundle::solve(&mut one, &tight(), &mut ()).expect("a good problem");
    let free = bundle::solve(&mut without, &tight(), &mut ()).expect("a good problem");
    assert!((report.final_cost / free.final_cost - 1.0).abs() < 1e-6, "{} {}", report.final_cost, free.final_cost);
}

#[test]
fn points_alone_follow_their_depths() {
    let truth = ring(&wide());
    let mut problem = truth.clone();
    problem.pose_freedom = vec![PoseFreedom::Fixed; problem.cam_from_world.len()];
    problem.refine_params[0] = [false; epipole_geometry::camera::MAX_PARAMS];
    perturb(&mut problem, 0.0, 0.05, 5);
    problem.depth = Some(depths(&truth, 1, |_| 1.05));
    let report = bundle::solve(&mut problem, &tight(), &mut ()).expect("a good problem");
    assert!(report.final_cost < report.initial_cost);
    // A little farther out, between what the pixels and what the depths say; exact pixels win nearly everything.
    let moved = problem.points.iter().zip(&truth.points).map(|(a, b)| (*a - *b).length()).sum::<f64>();
    let mean = moved / truth.points.len() as f64;
    assert!(mean > 1e-7 && mean < 0.01, "{mean}");
}

#[test]
fn bad_depths_are_refused_by_name() {
    let truth = ring(&wide());
    let count = truth.observation_image.len();
    let error = |change: &dyn Fn(&mut Problem, &mut Depth)| {
        let mut problem = truth.clone();
        let mut depth = depths(&truth, 2, |_| 1.0);
        change(&mut problem, &mut depth);
        problem.depth = Some(depth);
        match bundle::solve(&mut problem, &Options::default(), &mut ()) {
            Err(OptimizeError::Length { array, .. } | OptimizeError::Value { array, .. }) => array,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(error(&|_, d| d.inverse.truncate(count - 1)), "depth.inverse");
    assert_eq!(error(&|_, d| d.weight.truncate(count - 1)), "depth.weight");
    assert_eq!(error(&|_, d| d.inverse[3] = f64::NAN), "depth.inverse");
    assert_eq!(error(&|_, d| d.weight[3] = -1.0), "depth.weight");
    assert_eq!(error(&|_, d| d.loss = Loss::GemanMcClure(0.0)), "depth.loss");
    let sphere = |problem: &mut Problem, _: &mut Depth| {
        problem.cameras[0] = common::camera(0, CameraModel::Equirectangular, vec![2000.0, 1000.0]);
    };
    assert_eq!(error(&sphere), "depth.weight");
}
