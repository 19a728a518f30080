//! Times bundle adjustment of a scene of a given shape: `bundle_timing [IMAGES POINTS TRACK BAND]`.
//! The default has the shape of the bonsai scene (292 images, 65k points, 458k observations, one SIMPLE_RADIAL camera).

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use epipole_optimize::bundle::{self, Options, Problem, Solver};
use epipole_optimize::lm::{IterationRecord, LmReport, Observer};

struct Clock {
    start: Instant,
    optimum: f64,
    reached: Option<f64>,
}

impl Observer for Clock {
    fn iteration(&mut self, record: &IterationRecord) {
        let now = self.start.elapsed().as_secs_f64();
        if self.reached.is_none() && record.cost < 1.001 * self.optimum {
            self.reached = Some(now);
        }
        println!(
            "    {:2} cost {:.8e} lambda {:.0e} gain {:.3} inner {:3} at {:.3} s",
            record.iteration, record.cost, record.lambda, record.gain, record.inner_iterations, now
        );
    }
}

/// Processor time of this process in seconds: on a busy machine it says more than the clock does. 0 where unknown.
fn cpu_seconds() -> f64 {
    let Ok(stat) = std::fs::read_to_string("/proc/self/stat") else { return 0.0 };
    let fields: Vec<f64> = stat.split_whitespace().skip(13).take(2).filter_map(|f| f.parse().ok()).collect();
    // USER_HZ is 100 on every Linux this runs on.
    fields.iter().sum::<f64>() / 100.0
}

fn run(name: &str, problem: &Problem, options: &Options, single: bool, optimum: f64) -> LmReport {
    let mut problem = problem.clone();
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let mut clock = Clock { start, optimum, reached: None };
    let report = match single {
        true => bundle::solve_with::<f32>(&mut problem, options, &mut clock),
        false => bundle::solve(&mut problem, options, &mut clock),
    };
    let report = report.expect("a valid problem");
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{name}: {seconds:.3} s (processor {:.2} s), {:.3} s an iteration, cost {:.8e} (gap {:.1e}), to +0.1% {:?}, {:?}",
        cpu_seconds() - cpu,
        seconds / report.iterations.max(1) as f64,
        report.final_cost,
        report.final_cost / optimum - 1.0,
        clock.reached,
        report.termination
    );
    report
}

fn main() {
    let numbers: Vec<usize> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let get = |k: usize, default: usize| numbers.get(k).copied().unwrap_or(default);
    let (images, points) = (get(0, 292), get(1, 65_000));
    let scene = common::Scene { images, points, track: get(2, 7), band: get(3, 60), ..common::Scene::default() };
    let mut problem = common::ring(&scene);
    println!("{images} images, {points} points, {} observations", problem.observation_px.len());
    common::perturb(&mut problem, 0.5, 0.02, 1);
    let cholesky = Options { solver: Solver::Cholesky, ..Options::default() };
    let optimum = run("cholesky f64", &problem, &cholesky, false, 0.0).final_cost;
    run("cholesky f64", &problem, &cholesky, false, optimum);
    run("cholesky f32", &problem, &cholesky, true, optimum);
    let pcg = Options { solver: Solver::PcgImplicit, ..Options::default() };
    run("implicit f32", &problem, &pcg, true, optimum);
    run("auto f64", &problem, &Options::default(), false, optimum);
}
