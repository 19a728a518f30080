//! The table of `reference/solver.md` §3.3, column convex → VarPro, on the very scenes it was measured on.

use std::path::Path;

use glam::DVec3;

use super::on_gpu;
use crate::gpu::tests::device;
use crate::lm::LmOptions;
use crate::positioning::tests::scene::{KINDS, Noise, Random, aligned_error, scene};
use crate::positioning::{LinearSolver, Options, Problem, Report, solve};

/// Scene, then error and cost `Σ ρ` that the prototype (`solver_experiments/e2.py`, `convexvp`, f64) ends with. In
/// `street_clean` it stops in a flat valley, at 0.2420 or, with rays rounded as here, at 0.1755: an upper bound.
const TABLE: [(&str, f64, f64); 6] = [
    ("orbit_clean", 0.00659, 0.0241),
    ("orbit_dirty", 0.02300, 69.6152),
    ("street_clean", 0.00805, 0.2420),
    ("street_dirty", 0.04614, 69.6219),
    ("facade_clean", 0.01216, 0.0221),
    ("facade_dirty", 0.04560, 67.6927),
];

/// The threshold of the table.
const PROTOTYPE_HUBER: f64 = 0.1;

/// A scene of `tests/fixtures/positioning`: the problem and the true centres.
fn read(name: &str) -> (Problem, Vec<DVec3>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/positioning");
    let bytes = std::fs::read(folder.join(format!("{name}.bin"))).unwrap();
    let mut rest = bytes.as_slice();
    let mut take = |count: usize| {
        let (head, tail) = rest.split_at(count);
        rest = tail;
        head
    };
    let [cameras, points, observations] =
        std::array::from_fn(|_| u32::from_le_bytes(take(4).try_into().unwrap()) as usize);
    let reals: Vec<f64> =
        take(12 * cameras).chunks(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    let mut track_start = vec![0];
    for &count in take(points) {
        track_start.push(track_start[track_start.len() - 1] + u32::from(count));
    }
    let observation_image = take(observations).iter().map(|&i| u32::from(i)).collect();
    let parts: Vec<f64> =
        take(6 * observations).chunks(2).map(|b| f64::from(i16::from_le_bytes(b.try_into().unwrap()))).collect();
    let problem = Problem {
        centers: vec![DVec3::ZERO; cameras],
        points: vec![DVec3::ZERO; points],
        image_weight: vec![1.0; cameras],
        track_start,
        observation_image,
        observation_ray: parts.chunks(3).map(|r| DVec3::new(r[0], r[1], r[2]).normalize()).collect(),
        pinned_scale: None,
        pin_sigma: None,
    };
    (problem, reals.chunks(3).map(|c| DVec3::new(c[0], c[1], c[2])).collect())
}

/// Images, points and observations in another order; with the new place of each image.
fn shuffled(problem: &Problem, seed: u64) -> (Problem, Vec<usize>) {
    let mut random = Random(seed);
    let mut order = |count: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        (1..count).rev().for_each(|k| order.swap(k, random.below(k + 1)));
        order
    };
    let (place, points) = (order(problem.centers.len()), order(problem.points.len()));
    let mut out = problem.clone();
    out.track_start = vec![0];
    (out.observation_image, out.observation_ray) = (Vec::new(), Vec::new());
    for point in points {
        for o in problem.track(point).rev() {
            out.observation_image.push(place[problem.observation_image[o] as usize] as u32);
            out.observation_ray.push(problem.observation_ray[o]);
        }
        out.track_start.push(out.observation_image.len() as u32);
    }
    (out, place)
}

/// As the prototype went where the threshold is its own: one start, inexact steps, its tolerance. Else ours, retries
/// and all.
fn options(huber: f64) -> Options {
    let lm = LmOptions { max_iterations: 100, relative_decrease_tolerance: 1e-5, ..Options::default().lm };
    let ours = Options { huber, lm, ..Options::default() };
    match huber == PROTOTYPE_HUBER {
        true => Options { retry: false, linear_solver: LinearSolver::ConjugateGradients, ..ours },
        false => ours,
    }
}

fn line(what: &str, report: &Report, error: f64) {
    let kept = report.kept();
    println!(
        "  {what:22} {:?}: error {error:.4}, cost {:9.4}, {} + {} solves, {} + {} products",
        kept.start,
        2.0 * kept.lm.final_cost,
        kept.convex.solves,
        kept.lm.iterations,
        kept.convex.inner_iterations,
        kept.lm.inner_iterations
    );
}

#[test]
fn the_table_of_the_reference_is_reproduced() {
    let Some(device) = device() else { return };
    for (name, table_error, table_cost) in TABLE {
        println!("{name}: the reference has {table_error:.4} and {table_cost:.4}");
        for (huber, tolerance) in [(PROTOTYPE_HUBER, 0.05), (0.01, 0.1)] {
            let (problem, truth) = read(name);
            let mut on_cpu = problem.clone();
            let report = solve(&mut on_cpu, &options(huber), &mut ()).unwrap();
            let cpu_cost = report.kept().lm.final_cost;
            let cpu_error = aligned_error(&on_cpu.centers, &truth).0;
            line(&format!("Huber {huber}, CPU f64"), &report, cpu_error);
            for order in 0..4 {
                let place;
                let mut other;
                (other, place) = match order {
                    0 => (problem.clone(), (0..truth.len()).collect()),
                    _ => shuffled(&problem, order),
                };
                let report = on_gpu(&device, &mut other, &options(huber)).unwrap();
                let centers: Vec<DVec3> = place.iter().map(|&new| other.centers[new]).collect();
                let error = aligned_error(&centers, &truth).0;
                line(&format!("Huber {huber}, GPU, order {order}"), &report, error);
                let cost = report.kept().lm.final_cost;
                assert!((cost / cpu_cost - 1.0).abs() < 0.05, "{name}: {cost} {cpu_cost}");
                assert!((error / cpu_error - 1.0).abs() < tolerance, "{name}: {error} {cpu_error}");
                if huber == PROTOTYPE_HUBER {
                    assert!((error / table_error - 1.0).abs() < 0.05, "{name}: {error} {table_error}");
                    let ratio = 2.0 * cost / table_cost;
                    assert!(ratio < 1.05 && (ratio > 0.95 || name == "street_clean"), "{name}: {ratio}");
                }
            }
        }
    }
}

#[test]
fn other_draws_of_the_scenes_end_as_on_the_cpu() {
    let Some(device) = device() else { return };
    let dirty = Noise { ray_rad: 1e-3, rotation_deg: 1.0, outliers: 0.1 };
    for kind in KINDS {
        let errors = [0, 1, 2, 3].map(|seed| {
            let scene = scene(kind, dirty, seed);
            let (mut cpu, mut gpu) = (scene.problem.clone(), scene.problem);
            let on_cpu = solve(&mut cpu, &Options::default(), &mut ()).unwrap();
            let on_device = on_gpu(&device, &mut gpu, &Options::default()).unwrap();
            let [a, b] = [&cpu, &gpu].map(|problem| aligned_error(&problem.centers, &scene.centers).0);
            line(&format!("{kind:?} {seed}, CPU f64"), &on_cpu, a);
            line(&format!("{kind:?} {seed}, GPU"), &on_device, b);
            if on_cpu.kept().start == on_device.kept().start {
                let (a, b) = (on_cpu.kept().lm.final_cost, on_device.kept().lm.final_cost);
                assert!((a / b - 1.0).abs() < 0.02, "{kind:?} {seed}: {a} {b}");
            }
            [a, b]
        });
        println!("{kind:?}, four draws at 10 % and 1°: errors on CPU and GPU {errors:.4?}");
        // What rays alone do not determine (the open street) may end elsewhere in its valley.
        assert!(errors.iter().all(|[cpu, gpu]| *gpu < 1.2 * cpu), "{kind:?}: {errors:?}");
    }
}
