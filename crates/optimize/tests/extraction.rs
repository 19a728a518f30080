//! Dynamic parameter extraction on the CPU: bad starts and changing visibility end at the cost of the clean problem.

mod common;

use common::extraction::{Outcome, Scripted, assert_monotone, clean, far_off, hides, measure, options, out_of_sight};
use epipole_geometry::camera::Real;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::cpu::CpuSystem;
use epipole_optimize::bundle::{self, Problem};
use epipole_optimize::executor::block_on;
use epipole_optimize::lm::{LmReport, minimize};

/// What counts as the same cost.
const GAP: f64 = 1e-4;

fn optimum() -> Outcome {
    let truth = clean();
    let mut problem = truth.clone();
    bundle::solve(&mut problem, &options(Activation::ValidAtStart, 1e-10), &mut ()).expect("a good problem");
    measure(&problem, &truth)
}

fn solve<T: Real>(problem: &Problem, activation: Activation, script: bool) -> (LmReport, Outcome) {
    let tolerance = if T::EPSILON.to_f64() < 1e-10 { 1e-9 } else { 1e-7 };
    let options = options(activation, tolerance);
    let inner = CpuSystem::<T>::new(problem, &options).expect("a good problem");
    let script = |system: &mut CpuSystem<T>, step| {
        if script {
            system.occlude(|image, point| hides(step, image, point));
        }
    };
    let mut system = Scripted::new(inner, script);
    let mut report = block_on(minimize(&mut system, &options.lm, &mut ()));
    let mut problem = problem.clone();
    report.final_cost = system.inner.write(&mut problem);
    let outcome = measure(&problem, &clean());
    assert!(system.worst_rise < 1e-6, "{activation:?}: F rose by {:.1e}", system.worst_rise);
    println!(
        "{activation:?}: F {:.3} to {:.3}, {} of {} steps, {:?}, {outcome:?}",
        report.initial_cost, report.final_cost, report.accepted, report.iterations, report.termination
    );
    (report, outcome)
}

#[test]
fn points_that_start_out_of_sight_come_back() {
    let (start, optimum) = (out_of_sight(), optimum());
    println!("{optimum:?}");
    for (report, outcome) in
        [solve::<f64>(&start, Activation::DYNAMIC, false), solve::<f32>(&start, Activation::DYNAMIC, false)]
    {
        assert!((outcome.cost / optimum.cost - 1.0).abs() < GAP, "{outcome:?}");
        assert!((report.final_cost / optimum.cost - 1.0).abs() < GAP);
        assert_eq!((report.active, outcome.registered), (start.observation_px.len(), start.points.len()));
        assert_monotone(&report, 1e-6);
    }
    for activation in [Activation::ValidAtStart, Activation::All] {
        let (_, outcome) = solve::<f64>(&start, activation, false);
        assert!(outcome.cost > 2.0 * optimum.cost, "{activation:?}: {outcome:?}");
    }
}

#[test]
fn observations_hidden_on_the_way_count_again_when_they_are_revealed() {
    let (start, optimum) = (far_off(), optimum());
    for (report, outcome) in
        [solve::<f64>(&start, Activation::DYNAMIC, true), solve::<f32>(&start, Activation::DYNAMIC, true)]
    {
        assert!((outcome.cost / optimum.cost - 1.0).abs() < GAP, "{outcome:?}");
        assert_eq!(report.active, start.observation_px.len());
        let fewest = report.history.iter().map(|r| r.active).min();
        assert!(fewest < Some(start.observation_px.len() * 3 / 4), "nothing was hidden: {fewest:?}");
    }
    let (_, outcome) = solve::<f64>(&start, Activation::ValidAtStart, true);
    assert!(outcome.cost > (1.0 + 10.0 * GAP) * optimum.cost, "{outcome:?}");
}
