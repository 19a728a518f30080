//! Counts the products that a circuit takes: `preconditioner IMAGES [plain|two-level|auto|cholesky][:f32] …`.
//! The figures of `docs/preconditioner.md`.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use epipole_optimize::bundle::{self, Options, Preconditioner, Solver};
use epipole_optimize::lm::LmOptions;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let images = arguments.first().and_then(|a| a.parse().ok()).unwrap_or(200);
    let problem = common::circuit(images);
    println!("{images} images, {} points, {} observations", problem.points.len(), problem.observation_px.len());
    let optimum = common::circuit_optimum(&problem);
    println!("optimum {optimum:.9e} (f64, Cholesky)");
    for name in arguments.iter().skip(1) {
        let (kind, single) = name.strip_suffix(":f32").map_or((name.as_str(), false), |kind| (kind, true));
        let preconditioner = match kind {
            "plain" => Preconditioner::SchurJacobi,
            "two-level" => Preconditioner::TwoLevel,
            _ => Preconditioner::Auto,
        };
        let solver = if kind == "cholesky" { Solver::Cholesky } else { Solver::PcgImplicit };
        let lm = LmOptions { relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
        let options = Options { lm, solver, preconditioner, ..Options::default() };
        let mut problem = problem.clone();
        let start = Instant::now();
        let report = if single {
            bundle::solve_with::<f32>(&mut problem, &options, &mut ())
        } else {
            bundle::solve(&mut problem, &options, &mut ())
        };
        match report {
            Ok(report) => common::print_products(name, &report, optimum, start.elapsed().as_secs_f64()),
            Err(error) => println!("{name}: {error}"),
        }
    }
}
