//! Positions against the truth.

use glam::DVec3;

use super::scene::{KINDS, Kind, Noise, Random, aligned_error, scene};
use crate::lm::Termination;
use crate::positioning::{Grade, LinearSolver, Options, Problem, Start, solve, solve_with};

#[test]
fn exact_rays_give_exact_positions() {
    for kind in KINDS {
        let mut scene = scene(kind, Noise::default(), 1);
        let report = solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
        let (_, cameras) = aligned_error(&scene.problem.centers, &scene.centers);
        let (_, points) = aligned_error(&scene.problem.points, &scene.points);
        assert!(cameras < 1e-4 && points < 1e-3, "{kind:?} {cameras} {points}");
        assert_eq!(report.kept().quality.grade(), Grade::Good);
        assert_eq!(report.kept().start, Start::EqualScales);
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
        let mean = scene.problem.centers.iter().sum::<DVec3>() / 50.0;
        assert!(mean.length() < 1e-9, "the mean centre is the origin");
    }
}

/// The table of `reference/solver.md` §3.3, column convex → VarPro, has .007 .008 .012 without outliers at 0.3° and
/// .023 .046 .046 with 10 % at 1°, for one draw of the scene. Ours are other draws, so the median of five counts; and
/// the threshold is 0.01 where the table has 0.1.
#[test]
fn noisy_scenes_are_as_good_as_the_reference() {
    let clean = Noise { ray_rad: 1e-3, rotation_deg: 0.3, outliers: 0.0 };
    let dirty = Noise { ray_rad: 1e-3, rotation_deg: 1.0, outliers: 0.1 };
    let bounds = [(Kind::Orbit, 0.010, 0.032), (Kind::Street, 0.03, 0.09), (Kind::Facade, 0.015, 0.05)];
    for (kind, bound_clean, bound_dirty) in bounds {
        for (noise, bound) in [(clean, bound_clean), (dirty, bound_dirty)] {
            let mut errors: Vec<f64> = (0..5)
                .map(|seed| {
                    let mut scene = scene(kind, noise, seed);
                    let report = solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
                    assert_ne!(report.kept().lm.termination, Termination::MaxIterations, "{kind:?} {seed}");
                    aligned_error(&scene.problem.centers, &scene.centers).0
                })
                .collect();
            errors.sort_by(f64::total_cmp);
            println!("{kind:?} {noise:?}: {errors:.4?}");
            assert!(errors[2] < bound, "{kind:?} {noise:?}: {errors:?}");
        }
    }
}

#[test]
fn the_cost_never_rises() {
    for kind in KINDS {
        let noise = Noise { ray_rad: 2e-3, rotation_deg: 2.0, outliers: 0.2 };
        let mut scene = scene(kind, noise, 3);
        let report = solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
        for attempt in &report.attempts {
            let mut before = attempt.lm.initial_cost;
            for record in &attempt.lm.history {
                assert!(record.cost <= before, "{kind:?} iteration {}: {} > {before}", record.iteration, record.cost);
                before = record.cost;
            }
            assert!(attempt.lm.final_cost < attempt.lm.initial_cost);
        }
    }
}

/// Images and points renumbered, observations of each track turned round.
fn permuted(problem: &Problem, seed: u64) -> (Problem, Vec<usize>, Vec<usize>) {
    let mut random = Random(seed);
    let mut shuffle = |count: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        for k in (1..count).rev() {
            order.swap(k, random.below(k + 1));
        }
        order
    };
    let (images, points) = (shuffle(problem.centers.len()), shuffle(problem.points.len()));
    let mut new_image = vec![0; images.len()];
    images.iter().enumerate().for_each(|(new, &old)| new_image[old] = new as u32);
    let mut out = problem.clone();
    out.image_weight = images.iter().map(|&old| problem.image_weight[old]).collect();
    out.track_start = vec![0];
    (out.observation_image, out.observation_ray) = (Vec::new(), Vec::new());
    for &old in &points {
        for o in problem.track(old).rev() {
            out.observation_image.push(new_image[problem.observation_image[o] as usize]);
            out.observation_ray.push(problem.observation_ray[o]);
        }
        out.track_start.push(out.observation_image.len() as u32);
    }
    (out, images, points)
}

#[test]
fn the_order_of_images_and_points_does_not_matter() {
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 0.5, outliers: 0.05 };
    let mut scene = scene(Kind::Facade, noise, 4);
    let (mut other, images, points) = permuted(&scene.problem, 9);
    solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
    solve(&mut other, &Options::default(), &mut ()).unwrap();
    // The gauge's median is taken from every k-th observation; scale is compared apart from shape.
    let (_, cameras) =
        aligned_error(&other.centers, &images.iter().map(|&old| scene.problem.centers[old]).collect::<Vec<_>>());
    let (middle, _) =
        aligned_error(&other.points, &points.iter().map(|&old| scene.problem.points[old]).collect::<Vec<_>>());
    assert!(cameras < 1e-3 && middle < 1e-4, "{cameras} {middle}");
}

#[test]
fn all_linear_solvers_and_both_precisions_agree() {
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 0.5, outliers: 0.05 };
    let scene = scene(Kind::Orbit, noise, 5);
    let with = |solver| {
        let mut problem = scene.problem.clone();
        let options = Options { linear_solver: solver, ..Options::default() };
        let report = solve(&mut problem, &options, &mut ()).unwrap();
        (problem.centers, report)
    };
    let (exact, report) = with(LinearSolver::Cholesky);
    assert_eq!(report.kept().convex.inner_iterations, 0);
    let (inexact, inexact_report) = with(LinearSolver::ConjugateGradients);
    assert!(inexact_report.kept().lm.inner_iterations > inexact_report.kept().lm.iterations);
    let mut single = scene.problem.clone();
    let single_report = solve_with::<f32>(&mut single, &Options::default(), &mut ()).unwrap();
    let cost = report.kept().lm.final_cost;
    for (centers, report) in [(inexact, inexact_report), (single.centers, single_report)] {
        let (middle, _) = aligned_error(&centers, &exact);
        assert!(middle < 3e-3, "{middle}");
        let other = report.kept().lm.final_cost;
        assert!((other / cost - 1.0).abs() < 5e-3, "{other} {cost}");
    }
}

#[cfg(feature = "rayon")]
#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 0.5, outliers: 0.1 };
    for solver in [LinearSolver::Cholesky, LinearSolver::ConjugateGradients] {
        let results: Vec<Problem> = [1, 2, 5]
            .into_iter()
            .map(|threads| {
                let mut scene = scene(Kind::Street, noise, 6);
                let options = Options { linear_solver: solver, ..Options::default() };
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| solve(&mut scene.problem, &options, &mut ())).unwrap();
                scene.problem
            })
            .collect();
        for other in &results[1..] {
            assert_eq!(results[0].centers, other.centers);
            assert_eq!(results[0].points, other.points);
        }
    }
}
