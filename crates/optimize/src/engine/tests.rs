//! Where solves go when a device is lost, too weak or not worth it, and what the observer is told.

use std::rc::Rc;

use super::{DeviceEngine, Engine, Notice, Policy};
use crate::bundle::{self, Options, Problem};
use crate::common_for_tests as common;
use crate::executor::block_on;
use crate::gpu::{Device, GpuError, Limits};
use crate::lm::{IterationRecord, LmOptions, LmReport, Observer};

/// `None` with a loud line where the machine has no adapter.
fn engine(policy: Policy) -> Option<DeviceEngine> {
    match block_on(DeviceEngine::open(Limits::Default, policy)) {
        Ok(engine) => Some(engine),
        Err(error @ GpuError::NoAdapter { .. }) => {
            println!("SKIPPED, nothing was tested: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn problem() -> Problem {
    let mut problem = common::ring(&common::Scene::default());
    common::perturb(&mut problem, 0.5, 0.03, 4);
    problem
}

fn options() -> Options {
    let lm = LmOptions { max_iterations: 30, relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
    Options { lm, ..Options::default() }
}

/// Remembers everything, and destroys a device at an iteration.
#[derive(Default)]
struct Watch {
    sabotage: Option<(Rc<Device>, usize)>,
    iterations: Vec<usize>,
    notices: Vec<Notice>,
}

impl Observer for Watch {
    fn iteration(&mut self, record: &IterationRecord) {
        self.iterations.push(record.iteration);
        if let Some((device, _)) = self.sabotage.take_if(|(_, at)| *at == record.iteration) {
            device.destroy();
        }
    }

    fn notice(&mut self, notice: &Notice) {
        self.notices.push(notice.clone());
    }
}

/// Solves while the device is destroyed at the fourth iteration.
fn disturbed(engine: DeviceEngine, problem: &mut Problem) -> (Engine, LmReport, Watch) {
    let mut watch = Watch { sabotage: engine.device().map(|device| (device, 4)), ..Watch::default() };
    let mut engine = Engine::Gpu(engine);
    let report = block_on(engine.adjust(problem, &options(), &mut watch)).expect("a good problem");
    assert!(watch.sabotage.is_none(), "the solve ended before the fourth iteration");
    // Numbers go on where they were, less what was lost.
    let dropped = watch.iterations.windows(2).filter(|w| w[1] != w[0] + 1).count();
    assert!(dropped <= 1 && report.iterations >= 4, "{:?}", watch.iterations);
    (engine, report, watch)
}

#[test]
fn a_lost_device_is_replaced_and_the_solve_goes_on() {
    let Some(first) = engine(Policy::default()) else { return };
    let lost = first.device().expect("just opened");
    let optimum = bundle::solve(&mut problem(), &options(), &mut ()).expect("a good problem").final_cost;
    let (engine, report, watch) = disturbed(first, &mut problem());
    assert!((report.final_cost / optimum - 1.0).abs() < 1e-5, "{} {optimum}", report.final_cost);
    let [Notice::DeviceLost { resumed_on: Some(name), .. }] = &watch.notices[..] else { panic!("{:?}", watch.notices) };
    assert_eq!(*name, engine.description());
    let Engine::Gpu(engine) = engine else { panic!("still a device") };
    let new = engine.device().expect("a new one");
    assert!(!Rc::ptr_eq(&lost, &new) && new.check().is_ok());
}

#[test]
fn where_no_device_is_left_the_cpu_takes_over_and_says_so() {
    let Some(first) = engine(Policy { max_losses: 0, ..Policy::default() }) else { return };
    let optimum = bundle::solve(&mut problem(), &options(), &mut ()).expect("a good problem").final_cost;
    let (mut engine, report, watch) = disturbed(first, &mut problem());
    assert!((report.final_cost / optimum - 1.0).abs() < 1e-5, "{} {optimum}", report.final_cost);
    let [notice @ Notice::DeviceLost { resumed_on: None, .. }] = &watch.notices[..] else {
        panic!("{:?}", watch.notices)
    };
    assert!(notice.to_string().contains("CPU") && engine.description().contains("CPU"), "{notice}");
    // The next solve is the CPU's from the start, to the bit, and there is nothing new to tell.
    let (mut a, mut b, mut watch) = (problem(), problem(), Watch::default());
    block_on(engine.adjust(&mut a, &options(), &mut watch)).expect("a good problem");
    bundle::solve(&mut b, &options(), &mut ()).expect("a good problem");
    assert!(a.points == b.points && watch.notices.is_empty());
}

#[test]
fn small_problems_stay_on_the_cpu() {
    let Some(device) = engine(Policy { min_observations: 1_000_000, ..Policy::default() }) else { return };
    let (mut engine, mut a, mut b) = (Engine::Gpu(device), problem(), problem());
    let mut watch = Watch::default();
    block_on(engine.adjust(&mut a, &options(), &mut watch)).expect("a good problem");
    bundle::solve(&mut b, &options(), &mut ()).expect("a good problem");
    assert!(a.points == b.points && watch.notices.is_empty());
}

#[test]
fn what_the_device_cannot_do_is_said_once_or_an_error() {
    let error = GpuError::Unsupported { what: "telepathy" };
    let Some(mut lenient) = engine(Policy::default()) else { return };
    let mut watch = Watch::default();
    for _ in 0..2 {
        block_on(lenient.refused("bundle adjustment", error.clone(), &mut watch)).expect("the CPU's turn");
    }
    let [Notice::OnCpu { what: "bundle adjustment", reason }] = &watch.notices[..] else {
        panic!("{:?}", watch.notices)
    };
    assert!(reason.contains("telepathy"));
    let Some(mut strict) = engine(Policy { strict: true, ..Policy::default() }) else { return };
    assert_eq!(block_on(strict.refused("bundle adjustment", error.clone(), &mut watch)), Err(error.into()));
}
