//! Dynamic parameter extraction on a WebGPU device (lavapipe where there is no GPU), against the CPU.
#![cfg(feature = "gpu")]

mod common;

use common::device::device;
use common::extraction::{Outcome, Scripted, assert_monotone, clean, far_off, hides, measure, options, out_of_sight};
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::cpu::CpuSystem;
use epipole_optimize::bundle::gpu::GpuSystem;
use epipole_optimize::bundle::{self, Problem};
use epipole_optimize::gpu::Device;
use epipole_optimize::lm::{LmReport, System, minimize};
use pollster::block_on;

/// What counts as the same cost.
const GAP: f64 = 1e-4;

fn optimum() -> Outcome {
    let truth = clean();
    let mut problem = truth.clone();
    bundle::solve(&mut problem, &options(Activation::ValidAtStart, 1e-10), &mut ()).expect("a good problem");
    measure(&problem, &truth)
}

fn solve(device: &Device, problem: &Problem, activation: Activation, script: bool) -> (LmReport, Outcome) {
    let options = options(activation, 1e-7);
    let inner = GpuSystem::new(device, problem, &options).expect("a good problem");
    let script = |system: &mut GpuSystem<'_>, step| {
        if script {
            block_on(system.occlude(|image, point| hides(step, image, point))).expect("a live device");
        }
    };
    let mut system = Scripted::new(inner, script);
    let mut report = block_on(minimize(&mut system, &options.lm, &mut ()));
    let mut problem = problem.clone();
    report.final_cost = block_on(system.inner.write(&mut problem)).expect("a live device");
    let outcome = measure(&problem, &clean());
    println!(
        "{activation:?}: F {:.3} to {:.3}, {} of {} steps, {:?}, {outcome:?}",
        report.initial_cost, report.final_cost, report.accepted, report.iterations, report.termination
    );
    assert!(system.worst_rise < 1e-6, "{activation:?}: F rose by {:.1e}", system.worst_rise);
    (report, outcome)
}

#[test]
fn the_first_set_and_its_cost_are_those_of_the_cpu() {
    let Some(device) = device() else { return };
    for start in [out_of_sight(), far_off()] {
        for activation in [Activation::Truncated { residual_limit_px: 60.0 }, Activation::DYNAMIC] {
            let options = options(activation, 1e-7);
            let cpu = block_on(CpuSystem::<f64>::new(&start, &options).expect("a good problem").refresh(&mut ()));
            let gpu = block_on(GpuSystem::new(&device, &start, &options).expect("a good problem").refresh(&mut ()));
            println!("{activation:?}: {cpu:?} {gpu:?}");
            assert!(
                (gpu.cost / cpu.cost - 1.0).abs() < 1e-4 && gpu.active.abs_diff(cpu.active) <= 2,
                "{cpu:?} {gpu:?}"
            );
        }
    }
}

#[test]
fn points_that_start_out_of_sight_come_back() {
    let Some(device) = device() else { return };
    let (start, optimum) = (out_of_sight(), optimum());
    let (report, outcome) = solve(&device, &start, Activation::DYNAMIC, false);
    assert!((outcome.cost / optimum.cost - 1.0).abs() < GAP, "{outcome:?}");
    assert!((report.final_cost / optimum.cost - 1.0).abs() < GAP);
    assert_eq!((report.active, outcome.registered), (start.observation_px.len(), start.points.len()));
    assert_monotone(&report, 1e-6);
    let (_, outcome) = solve(&device, &start, Activation::ValidAtStart, false);
    assert!(outcome.cost > 2.0 * optimum.cost, "{outcome:?}");
}

#[test]
fn observations_hidden_on_the_way_count_again_when_they_are_revealed() {
    let Some(device) = device() else { return };
    let (start, optimum) = (far_off(), optimum());
    let (report, outcome) = solve(&device, &start, Activation::DYNAMIC, true);
    assert!((outcome.cost / optimum.cost - 1.0).abs() < GAP, "{outcome:?}");
    assert_eq!(report.active, start.observation_px.len());
    let fewest = report.history.iter().map(|r| r.active).min();
    assert!(fewest < Some(start.observation_px.len() * 3 / 4), "nothing was hidden: {fewest:?}");
}
