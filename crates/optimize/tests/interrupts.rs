//! A person who pauses, stops or watches a solve: gets in between kernels, loses nothing, changes nothing.

mod common;

use std::cell::Cell;

use common::Scene;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{self, Options, Problem};
use epipole_optimize::executor::block_on;
use epipole_optimize::lm::{Breath, IterationRecord, LmOptions, LmReport, Observer, Places, Termination};

/// Breathes at every opportunity, and asks to stop from a breath on.
#[derive(Default)]
struct Person {
    breaths: usize,
    stop_at: Option<usize>,
    history: Vec<(usize, IterationRecord)>,
    watches: bool,
    seen: Vec<Places>,
    asked: Cell<usize>,
}

impl Observer for Person {
    fn iteration(&mut self, record: &IterationRecord) {
        self.history.push((self.breaths, *record));
    }

    fn wants_places(&self) -> bool {
        self.asked.set(self.asked.get() + 1);
        self.watches
    }

    fn places(&mut self, places: &Places) {
        self.seen.push(places.clone());
    }

    fn should_stop(&self) -> bool {
        self.stop_at.is_some_and(|at| self.breaths >= at)
    }

    fn interrupts(&self) -> bool {
        true
    }

    fn breathe(&mut self) -> Option<Breath> {
        self.breaths += 1;
        // Not ready at once, as in a tab: the solve must really wait.
        let mut waited = false;
        Some(Box::pin(std::future::poll_fn(move |context| {
            if std::mem::replace(&mut waited, true) {
                return std::task::Poll::Ready(());
            }
            context.waker().wake_by_ref();
            std::task::Poll::Pending
        })))
    }
}

fn problem() -> Problem {
    let mut problem = common::ring(&Scene::default());
    common::perturb(&mut problem, 0.3, 0.02, 3);
    problem
}

fn options() -> Options {
    let lm = LmOptions { max_iterations: 40, relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
    Options { lm, activation: Activation::ValidAtStart, ..Options::default() }
}

/// The cost of a state by the CPU's count.
fn cost(problem: &Problem) -> f64 {
    let none = Options { lm: LmOptions { max_iterations: 0, ..options().lm }, ..options() };
    bundle::solve(&mut problem.clone(), &none, &mut ()).expect("a good problem").initial_cost
}

/// Solves with a person looking on, wherever `solve` does.
type Solve<'a> = dyn Fn(&mut Problem, &mut dyn Observer) -> LmReport + 'a;

/// Stops at breaths all through a solve, also within steps: what is left is always the last accepted state.
fn stops_anywhere(solve: &Solve<'_>, least_breaths_a_step: usize) {
    let (mut alone, mut watched, mut person) = (problem(), problem(), Person::default());
    let undisturbed = solve(&mut alone, &mut ());
    let whole = solve(&mut watched, &mut person);
    assert_eq!(undisturbed, whole, "a person who only looks on changes nothing");
    assert_eq!((alone.points, alone.cam_from_world), (watched.points, watched.cam_from_world));
    assert!(person.breaths >= least_breaths_a_step * whole.iterations, "{} breaths in {whole:?}", person.breaths);
    for stop_at in (1..person.breaths).step_by(1 + person.breaths / 9) {
        let mut stopped = problem();
        let mut person = Person { stop_at: Some(stop_at), ..Person::default() };
        let report = solve(&mut stopped, &mut person);
        assert_eq!(report.termination, Termination::Stopped, "at {stop_at}");
        assert!(person.breaths <= stop_at + 3, "{} breaths after the wish to stop", person.breaths - stop_at);
        let accepted = person.history.iter().rev().find(|(_, record)| record.accepted);
        let expected = accepted.map_or(whole.initial_cost, |(_, record)| record.cost);
        let found = cost(&stopped);
        assert!((found / expected - 1.0).abs() < 1e-5, "stopped at {stop_at}: {found} instead of {expected}");
        assert_eq!(report.iterations, person.history.len(), "a step that was given up is none");
    }
}

#[test]
fn the_processor_stops_within_a_step() {
    let solve = |problem: &mut Problem, observer: &mut dyn Observer| {
        block_on(bundle::solve_async::<f64>(problem, &options(), observer)).expect("a good problem")
    };
    stops_anywhere(&solve, 3);
}

#[cfg(feature = "gpu")]
mod gpu {
    use super::*;
    use common::device::device;

    #[test]
    fn a_slow_device_is_given_a_kernel_at_a_time() {
        let Some(device) = device() else { return };
        let solve = |problem: &mut Problem, observer: &mut dyn Observer| {
            pollster::block_on(bundle::gpu::solve(&device, problem, &options(), observer)).expect("a good problem")
        };
        // On hardware so small a problem is a single turn.
        stops_anywhere(&solve, if device.is_software() { 20 } else { 3 });
    }

    #[test]
    fn what_is_seen_of_a_solve_on_a_device_are_its_accepted_states() {
        let Some(device) = device() else { return };
        let (mut problem, mut person) = (problem(), Person { watches: true, ..Person::default() });
        let report = pollster::block_on(bundle::gpu::solve(&device, &mut problem, &options(), &mut person));
        let report = report.expect("a good problem");
        assert_eq!(person.asked.get(), report.accepted);
        assert!(person.seen.len() + 2 >= report.accepted, "{} of {report:?}", person.seen.len());
        let mut before = f64::INFINITY;
        for places in &person.seen {
            assert_eq!(
                (places.centers.len(), places.points.len()),
                (problem.cam_from_world.len(), problem.points.len())
            );
            let errors = places.points.iter().map(|&(p, position)| position.distance(problem.points[p as usize]));
            let mean = errors.sum::<f64>() / places.points.len() as f64;
            assert!(mean < 1.5 * before, "{mean} after {before}");
            before = mean;
            let off = |&(i, center): &(u32, glam::DVec3)| center.distance(problem.cam_from_world[i as usize].center());
            assert!(places.centers.iter().map(off).fold(0.0, f64::max) < 1.0);
        }
        assert!(before < 1e-3, "the last that was seen is near the end: {before}");
    }
}
