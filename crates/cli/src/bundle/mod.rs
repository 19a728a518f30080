//! `epipole bundle`: bundle adjustment of a BAL file or a COLMAP model.

mod from_bal;
mod from_model;

use std::time::Instant;

use epipole_formats::{bal, write_model_binary};
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{Options, Problem, solve_with};
use epipole_optimize::engine::Notice;
use epipole_optimize::executor::block_on;
use epipole_optimize::lm::{IterationRecord, LmOptions, LmReport, Observer, Termination};
use epipole_optimize::{Engine, Loss};
use serde_json::json;

use crate::args::{BundleArgs, Precision};
use crate::backend::{self, Size};
use crate::error::CliError;
use crate::{interrupt, locate, output};

pub(crate) fn run(args: &BundleArgs) -> Result<(), CliError> {
    check(args)?;
    locate::use_threads(args.threads)?;
    interrupt::install();
    let report = if args.problem.is_dir() {
        let mut reconstruction = locate::read(&args.problem, args.json)?;
        announce_read(args);
        let mut problem = from_model::problem(&reconstruction, args.intrinsics)?;
        let report = solve(&mut problem, Activation::default(), args)?;
        if let Some(out) = &args.output {
            from_model::apply(&problem, &mut reconstruction);
            write_model_binary(out, &reconstruction).map_err(CliError::Output)?;
        }
        report
    } else {
        let mut bal = bal::read_bal(&args.problem).map_err(CliError::Input)?;
        announce_read(args);
        let (mut problem, flips) = from_bal::problem(&bal)?;
        // BAL's formula holds behind the camera, too, and its published costs count every observation.
        let report = solve(&mut problem, Activation::All, args)?;
        if let Some(out) = &args.output {
            from_bal::apply(&problem, &flips, &mut bal);
            bal::write_bal(out, &bal).map_err(CliError::Output)?;
        }
        report
    };
    match report.termination {
        Termination::Stopped => Err(CliError::Stopped(format!(
            "stopped after {} steps at cost {:e}{}",
            report.iterations,
            report.final_cost,
            args.output.as_ref().map_or_else(String::new, |out| format!("; that state is in {}", out.display()))
        ))),
        Termination::NothingToSolve => Err(CliError::Usage(
            "no point is seen by a camera it lies in front of: there is nothing to adjust; check the problem".into(),
        )),
        _ => Ok(()),
    }
}

/// From here on the time is the solver's; a benchmark subtracts what came before.
fn announce_read(args: &BundleArgs) {
    if args.json {
        output::json_line(&json!({ "event": "read" }));
    }
}

fn check(args: &BundleArgs) -> Result<(), CliError> {
    if args.huber.is_some_and(|width| !(width > 0.0 && width.is_finite())) {
        return Err(CliError::Usage("--huber must be a positive number of pixels".into()));
    }
    if !(args.tolerance >= 0.0 && args.tolerance < 1.0) {
        return Err(CliError::Usage("--tolerance must be at least 0 and below 1".into()));
    }
    Ok(())
}

fn solve(problem: &mut Problem, activation: Activation, args: &BundleArgs) -> Result<LmReport, CliError> {
    problem.loss = args.huber.map_or(Loss::Squared, Loss::Huber);
    let lm = LmOptions {
        max_iterations: args.max_iterations,
        relative_decrease_tolerance: args.tolerance,
        // Benchmarks end in valleys flatter than the default damping (49-7776: +8e-7 with it, +5e-8 without).
        lambda_min: if args.precision == Precision::F64 { 1e-12 } else { LmOptions::default().lambda_min },
        ..LmOptions::default()
    };
    let options = Options { lm, activation, ..Options::default() };
    let mut engine = backend::engine(args.backend, Size::Observations(problem.observation_px.len()), true)?;
    let start = Instant::now();
    let mut watch = Watch { json: args.json };
    let report = match (&engine, args.precision) {
        (Engine::Cpu, Precision::F32) => solve_with::<f32>(problem, &options, &mut watch)?,
        _ => block_on(engine.adjust(problem, &options, &mut watch))?,
    };
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        output::json_line(&json!({
            "event": "finished",
            "engine": engine.description(),
            "images": problem.cam_from_world.len(),
            "points": problem.points.len(),
            "observations": problem.observation_px.len(),
            "active_observations": report.active,
            "initial_cost": report.initial_cost,
            "final_cost": report.final_cost,
            "iterations": report.iterations,
            "accepted": report.accepted,
            "inner_iterations": report.inner_iterations,
            "termination": format!("{:?}", report.termination),
            "seconds": seconds,
        }));
    } else {
        output::line(&format!(
            "{} images, {} points, {} of {} observations",
            problem.cam_from_world.len(),
            problem.points.len(),
            report.active,
            problem.observation_px.len()
        ));
        output::line(&format!(
            "cost {:.9e} -> {:.9e} in {} steps ({} accepted), {seconds:.2} s: {:?}",
            report.initial_cost, report.final_cost, report.iterations, report.accepted, report.termination
        ));
    }
    Ok(report)
}

/// Shows the steps and passes Ctrl-C on.
struct Watch {
    json: bool,
}

impl Observer for Watch {
    fn iteration(&mut self, record: &IterationRecord) {
        if self.json {
            output::json_line(&json!({
                "event": "iteration", "iteration": record.iteration, "cost": record.cost, "damping": record.lambda,
                "active_observations": record.active, "accepted": record.accepted,
            }));
        } else {
            let verdict = if record.accepted { "" } else { "  refused" };
            eprintln!("{:4}  cost {:.9e}  damping {:.1e}{verdict}", record.iteration, record.cost, record.lambda);
        }
    }

    fn notice(&mut self, notice: &Notice) {
        if self.json {
            output::json_line(&json!({ "event": "warning", "message": notice.to_string() }));
        } else {
            eprintln!("warning: {notice}");
        }
    }

    fn should_stop(&self) -> bool {
        interrupt::requested()
    }
}
