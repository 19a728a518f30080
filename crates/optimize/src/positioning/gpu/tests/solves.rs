//! Whole solves against the CPU: exact rays, pins, retries, garbage, chunks, the same bytes, a lost device.

use glam::DVec3;
use pollster::block_on;

use super::super::chunks::CHUNK_OBSERVATIONS;
use super::super::processor::Gpu;
use super::super::solve_in_chunks;
use super::on_gpu;
use crate::error::OptimizeError;
use crate::gpu::tests::device;
use crate::gpu::{Device, GpuError};
use crate::lm::{IterationRecord, Observer};
use crate::positioning::backend::Backend;
use crate::positioning::convex::equal_scales;
use crate::positioning::layout::{Layout, Rays};
use crate::positioning::tests::metric::{doubt, pin, scale};
use crate::positioning::tests::scene::{KINDS, Kind, Noise, Random, aligned_error, garbage, scene};
use crate::positioning::{Grade, Options, Start, solve};

const NOISE: Noise = Noise { ray_rad: 1e-3, rotation_deg: 0.5, outliers: 0.05 };

#[test]
fn exact_rays_give_exact_positions() {
    let Some(device) = device() else { return };
    for kind in KINDS {
        let mut scene = scene(kind, Noise::default(), 1);
        let report = on_gpu(&device, &mut scene.problem, &Options::default()).unwrap();
        let (_, cameras) = aligned_error(&scene.problem.centers, &scene.centers);
        let (points, _) = aligned_error(&scene.problem.points, &scene.points);
        println!("{kind:?}: cameras {cameras:.1e}, points {points:.1e}, {:?}", report.kept().lm.termination);
        assert!(cameras < 1e-4 && points < 1e-4, "{kind:?} {cameras} {points}");
        assert_eq!(report.kept().quality.grade(), Grade::Good);
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    }
}

#[test]
fn pins_make_the_world_metric_as_on_the_cpu() {
    let Some(device) = device() else { return };
    for kind in KINDS {
        let mut exact = scene(kind, Noise::default(), 1);
        pin(&mut exact, 1.1, 0.0);
        let report = on_gpu(&device, &mut exact.problem, &Options::default()).unwrap();
        assert!((scale(&exact) - 1.0).abs() < 1e-4, "{kind:?} {}", scale(&exact));
        assert!(aligned_error(&exact.problem.centers, &exact.centers).1 < 1e-4);
        assert!((report.metric_scale_correction.unwrap() - 1.0).abs() < 1e-4);

        let mut noisy = scene(kind, NOISE, 3);
        pin(&mut noisy, 0.3, 0.1);
        doubt(&mut noisy);
        let mut on_cpu = noisy.problem.clone();
        let cpu = solve(&mut on_cpu, &Options::default(), &mut ()).unwrap();
        let gpu = on_gpu(&device, &mut noisy.problem, &Options::default()).unwrap();
        let (a, b) = (gpu.kept().lm.final_cost, cpu.kept().lm.final_cost);
        assert!((a / b - 1.0).abs() < 5e-3, "{kind:?}: {a} {b}");
        // Not aligned: the metric world has no free scale.
        let extent = on_cpu.centers.iter().map(|c| c.length()).fold(0.0, f64::max);
        let apart = on_cpu.centers.iter().zip(&noisy.problem.centers).map(|(a, b)| (*a - *b).length());
        let apart = apart.fold(0.0, f64::max) / extent;
        println!("{kind:?}: centres apart {apart:.1e} of the extent");
        assert!(apart < 5e-3, "{kind:?}: {apart}");
    }
}

#[test]
fn a_hopeless_scene_is_retried_as_on_the_cpu() {
    let Some(device) = device() else { return };
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 5.0, outliers: 0.75 };
    let mut problem = scene(Kind::Facade, noise, 8).problem;
    let cpu = solve(&mut problem.clone(), &Options::default(), &mut ()).unwrap();
    let gpu = on_gpu(&device, &mut problem, &Options::default()).unwrap();
    let starts: Vec<Start> = gpu.attempts.iter().map(|attempt| attempt.start).collect();
    assert_eq!(starts, [Start::EqualScales, Start::Lud, Start::Clipped]);
    for (a, b) in gpu.attempts.iter().zip(&cpu.attempts) {
        println!("{:?}: {:?} {}, CPU {:?} {}", a.start, a.convex, a.lm.final_cost, b.convex, b.lm.final_cost);
        let relative = |a: f64, b: f64| (a - b).abs() <= 0.02 * b;
        assert!(relative(a.convex.cost, b.convex.cost) && relative(a.lm.final_cost, b.lm.final_cost));
    }
    assert_eq!(gpu.kept().quality.grade(), Grade::Suspicious);
}

#[test]
fn chunks_of_a_thousand_observations_give_the_result_of_one() {
    let Some(device) = device() else { return };
    let mut whole = scene(Kind::Orbit, NOISE, 5);
    pin(&mut whole, 0.2, 0.05);
    let mut cut = whole.problem.clone();
    let one = on_gpu(&device, &mut whole.problem, &Options::default()).unwrap();
    let many = block_on(solve_in_chunks(&device, &mut cut, &Options::default(), &mut (), 1000)).unwrap();
    let (a, b) = (one.kept().lm.final_cost, many.kept().lm.final_cost);
    assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    let apart = whole.problem.centers.iter().zip(&cut.centers).map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max);
    assert!(apart < 2e-3, "{apart}");
}

#[test]
fn the_same_problem_gives_the_same_bytes() {
    let Some(device) = device() else { return };
    let start = scene(Kind::Street, NOISE, 6).problem;
    let (mut a, mut b) = (start.clone(), start);
    let reports = [&mut a, &mut b].map(|problem| on_gpu(&device, problem, &Options::default()).unwrap());
    assert_eq!(reports[0], reports[1]);
    assert_eq!((a.centers, a.points), (b.centers, b.points));
}

#[test]
fn read_backs_and_bytes_are_within_budget() {
    let Some(device) = device() else { return };
    let mut problem = scene(Kind::Orbit, NOISE, 6).problem;
    // Every point eight times: what does not grow with the problem must not count.
    let (images, rays) = (problem.observation_image.clone(), problem.observation_ray.clone());
    for copy in 1..8 {
        problem.observation_image.extend(&images);
        problem.observation_ray.extend(&rays);
        let ends = problem.track_start[1..problem.points.len() / copy + 1].to_vec();
        problem.track_start.extend(ends.iter().map(|end| end + (copy * rays.len()) as u32));
        problem.points.extend(vec![DVec3::ZERO; ends.len()]);
    }
    let layout = Layout::new(&problem, None).unwrap();
    let rays = Rays::<f32>::new(&problem, &layout);
    let mut gpu = Gpu::new(&device, &layout, &rays, CHUNK_OBSERVATIONS).unwrap();
    let convex = block_on(equal_scales(&mut gpu, 1.0, &mut ())).unwrap();
    let begun = gpu.read_backs;
    assert!(begun <= 1 + 2 * convex.solves, "{begun} for {} convex solves", convex.solves);
    let report = block_on(gpu.project(&rays, &Options::default(), &mut ())).unwrap();
    let used = gpu.read_backs - begun;
    println!("{used} read-backs in {} accepted steps", report.accepted);
    assert!(used <= 1 + 2 * report.accepted, "{used} for {}", report.accepted);
    let per_observation = gpu.resident_bytes() as f64 / layout.observations() as f64;
    println!("{per_observation:.1} bytes an observation");
    assert!(per_observation <= 60.0, "{per_observation}");
}

/// Destroys the device after a few iterations.
struct Saboteur<'a>(&'a Device);

impl Observer for Saboteur<'_> {
    fn iteration(&mut self, record: &IterationRecord) {
        if record.iteration == 2 {
            self.0.destroy();
        }
    }
}

#[test]
fn a_lost_device_is_an_error_and_the_problem_can_be_solved_elsewhere() {
    let (Some(lost), Some(next)) = (device(), device()) else { return };
    let mut problem = scene(Kind::Facade, NOISE, 6).problem;
    problem.centers.fill(DVec3::splat(7.0));
    let before = problem.clone();
    let result = block_on(super::super::solve(&lost, &mut problem, &Options::default(), &mut Saboteur(&lost)));
    assert!(matches!(result, Err(OptimizeError::Gpu(GpuError::Lost { .. }))), "{result:?}");
    assert_eq!((&problem.centers, &problem.points), (&before.centers, &before.points));
    let again = block_on(super::super::solve(&lost, &mut problem, &Options::default(), &mut ()));
    assert!(matches!(again, Err(OptimizeError::Gpu(GpuError::Lost { .. }))), "{again:?}");
    let found = on_gpu(&next, &mut problem, &Options::default()).unwrap().kept().lm.final_cost;
    let wanted = solve(&mut before.clone(), &Options::default(), &mut ()).unwrap().kept().lm.final_cost;
    assert!((found / wanted - 1.0).abs() < 5e-3, "{found} {wanted}");
}

#[test]
fn garbage_gives_finite_positions_or_an_error() {
    let Some(device) = device() else { return };
    let mut random = Random(11);
    for _ in 0..25 {
        let mut problem = garbage(&mut random);
        match on_gpu(&device, &mut problem, &Options::default()) {
            Ok(_) => assert!(problem.centers.iter().chain(&problem.points).all(|p| p.is_finite())),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    assert!(device.check().is_ok());
}
