//! The ablation of dynamic parameter extraction as a table in Markdown: scenes, ways of choosing observations, devices.
//! `cargo run --release -p epipole-optimize --features gpu --example dynamic_extraction`

#[path = "../tests/common/mod.rs"]
mod common;

use std::process::ExitCode;

use common::extraction::{Outcome, Scripted, clean, far_off, hides, measure, options, out_of_sight};
use epipole_optimize::OptimizeError;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::cpu::CpuSystem;
use epipole_optimize::bundle::gpu::GpuSystem;
use epipole_optimize::bundle::{self, Problem};
use epipole_optimize::gpu::{Device, Limits};
use epipole_optimize::lm::{LmReport, minimize};
use pollster::block_on;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), OptimizeError> {
    let truth = clean();
    let mut best = truth.clone();
    bundle::solve(&mut best, &options(Activation::ValidAtStart, 1e-10), &mut ())?;
    let optimum = measure(&best, &truth);
    println!("clean problem: {} points, cost {:.4}", truth.points.len(), optimum.cost);
    println!();
    println!("| scene | extraction | device | cost gap | points within 4 px | steps | end | worst relative pose |");
    println!("|---|---|---|---|---|---|---|---|");
    let device = block_on(Device::open(Limits::Default));
    if let Err(error) = &device {
        println!("no device: {error}");
    }
    let ways = [("on", Activation::DYNAMIC), ("off: start", Activation::ValidAtStart), ("off: all", Activation::All)];
    for (scene, start, script) in [("out of sight", out_of_sight(), false), ("hidden and revealed", far_off(), true)] {
        for (way, activation) in ways {
            let (report, outcome) = on_cpu(&start, activation, script, &truth)?;
            row(scene, way, "CPU, f64", &report, &outcome, &optimum);
            if let Ok(device) = &device {
                let (report, outcome) = on_device(device, &start, activation, script, &truth)?;
                row(scene, way, "WebGPU, f32", &report, &outcome, &optimum);
            }
        }
    }
    Ok(())
}

fn on_cpu(
    start: &Problem,
    activation: Activation,
    script: bool,
    truth: &Problem,
) -> Result<(LmReport, Outcome), OptimizeError> {
    let options = options(activation, 1e-9);
    let script = |system: &mut CpuSystem<f64>, step| {
        if script {
            system.occlude(|image, point| hides(step, image, point));
        }
    };
    let mut system = Scripted::new(CpuSystem::<f64>::new(start, &options)?, script);
    let report = block_on(minimize(&mut system, &options.lm, &mut ()));
    let mut problem = start.clone();
    system.inner.write(&mut problem);
    Ok((report, measure(&problem, truth)))
}

fn on_device(
    device: &Device,
    start: &Problem,
    activation: Activation,
    script: bool,
    truth: &Problem,
) -> Result<(LmReport, Outcome), OptimizeError> {
    let options = options(activation, 1e-7);
    let mut failure = None;
    let script = |system: &mut GpuSystem<'_>, step| {
        if script {
            let told = block_on(system.occlude(|image, point| hides(step, image, point)));
            failure = failure.take().or(told.err());
        }
    };
    let mut system = Scripted::new(GpuSystem::new(device, start, &options)?, script);
    let report = block_on(minimize(&mut system, &options.lm, &mut ()));
    let mut problem = start.clone();
    block_on(system.inner.write(&mut problem))?;
    match failure {
        Some(error) => Err(error.into()),
        None => Ok((report, measure(&problem, truth))),
    }
}

fn row(scene: &str, way: &str, device: &str, report: &LmReport, outcome: &Outcome, optimum: &Outcome) {
    println!(
        "| {scene} | {way} | {device} | {:+.1e} | {} | {} of {} | {:?} | {:.2}° |",
        outcome.cost / optimum.cost - 1.0,
        outcome.registered,
        report.accepted,
        report.iterations,
        report.termination,
        outcome.worst_pose_deg
    );
}
