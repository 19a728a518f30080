//! Counts the products that a circuit takes: `preconditioner IMAGES [plain|two-level|cholesky][:f32|:gpu] …`; `:gpu`
//! with `--features gpu`. The figures of `docs/preconditioner.md`.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use epipole_optimize::OptimizeError;
use epipole_optimize::bundle::{self, Options, Preconditioner, Problem, Solver};
use epipole_optimize::lm::{LmOptions, LmReport};

#[cfg(feature = "gpu")]
fn on_device(problem: &mut Problem, options: &Options) -> Result<LmReport, OptimizeError> {
    use epipole_optimize::gpu::{Device, Limits};
    let device = pollster::block_on(Device::open(Limits::Default))?;
    println!("on {}", device.description());
    pollster::block_on(bundle::gpu::solve(&device, problem, options, &mut ()))
}

#[cfg(not(feature = "gpu"))]
fn on_device(problem: &mut Problem, options: &Options) -> Result<LmReport, OptimizeError> {
    println!("built without --features gpu, on the processor in f32:");
    bundle::solve_with::<f32>(problem, options, &mut ())
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let images = arguments.first().and_then(|a| a.parse().ok()).unwrap_or(200);
    let problem = common::circuit(images);
    println!("{images} images, {} points, {} observations", problem.points.len(), problem.observation_px.len());
    let optimum = common::circuit_optimum(&problem);
    println!("optimum {optimum:.9e} (f64, Cholesky)");
    for name in arguments.iter().skip(1) {
        let (kind, where_) = name.split_once(':').unwrap_or((name, "f64"));
        let preconditioner = if kind == "plain" { Preconditioner::SchurJacobi } else { Preconditioner::TwoLevel };
        let solver = if kind == "cholesky" { Solver::Cholesky } else { Solver::PcgImplicit };
        let lm = LmOptions { relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
        let options = Options { lm, solver, preconditioner, ..Options::default() };
        let mut problem = problem.clone();
        let start = Instant::now();
        let report = match where_ {
            "gpu" => on_device(&mut problem, &options),
            "f32" => bundle::solve_with::<f32>(&mut problem, &options, &mut ()),
            _ => bundle::solve(&mut problem, &options, &mut ()),
        };
        match report {
            Ok(report) => common::print_products(name, &report, optimum, start.elapsed().as_secs_f64()),
            Err(error) => println!("{name}: {error}"),
        }
    }
}
