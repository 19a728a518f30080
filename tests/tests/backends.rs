//! The pipeline on a WebGPU device (lavapipe where there is no GPU) ends where it ends on the CPU, also when the device is
//! lost on the way. `cargo xtask bench backends` does the same for every scene of the goal.
#![cfg(feature = "gpu")]

mod common;

use std::rc::Rc;

use common::{check_consistent, compare};
use epipole_formats::{ReadOptions, read_database, read_model};
use epipole_mapper::{Event, Intrinsics, Observer, Options, Outcome, Stage, reconstruct_blocking};
use epipole_optimize::Engine;
use epipole_optimize::engine::{DeviceEngine, Policy};
use epipole_optimize::executor::block_on;
use epipole_optimize::gpu::{Device, GpuError, Limits};
use epipole_scene::{Reconstruction, ViewGraph};
use epipole_tests::{fixtures, shared_data};

/// `None` with a loud line where the machine has no adapter.
fn device() -> Option<DeviceEngine> {
    match block_on(DeviceEngine::open(Limits::Default, Policy::default())) {
        Ok(engine) => Some(engine),
        Err(error @ GpuError::NoAdapter { .. }) => {
            println!("SKIPPED, nothing was tested: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Remembers what was said, and destroys a device at the first iteration of a stage.
#[derive(Default)]
struct Watch {
    sabotage: Option<(Rc<Device>, Stage)>,
    warnings: Vec<String>,
    losses: Vec<Event>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event) {
        match event {
            Event::Iteration { stage, .. } => {
                if let Some((device, _)) = self.sabotage.take_if(|(_, at)| at == stage) {
                    device.destroy();
                }
            }
            Event::Warning { message } => self.warnings.push(message.clone()),
            Event::DeviceLost { .. } => self.losses.push(event.clone()),
            _ => {}
        }
    }
}

fn reconstruct(graph: &ViewGraph, options: &Options, engine: &mut Engine, watch: &mut Watch) -> Outcome {
    let outcome = reconstruct_blocking(graph.clone(), options, engine, None, watch).expect("a reconstruction");
    outcome.reconstructions.iter().for_each(check_consistent);
    outcome
}

fn graph_of(database: &std::path::Path) -> ViewGraph {
    read_database(database, &ReadOptions::default()).expect("the database").value
}

#[test]
fn real_scenes_are_as_accurate_as_on_the_cpu() {
    let Some(device) = device() else { return };
    let mut engine = Engine::Gpu(device);
    for (scene, intrinsics) in
        [("strecha_Herz-Jesus-P8", Intrinsics::Refine), ("middlebury_templering19", Intrinsics::Fixed)]
    {
        let Some(folder) = shared_data::scene(scene) else { return };
        let graph = graph_of(&folder.join("database.db"));
        let truth: Reconstruction = read_model(&folder.join("gt/sparse")).expect("the truth").value;
        let options = Options { intrinsics, ..Options::default() };
        let mut watch = Watch::default();
        let on_gpu = reconstruct(&graph, &options, &mut engine, &mut watch);
        // Everything ran on the device.
        assert!(watch.warnings.is_empty() && watch.losses.is_empty(), "{:?} {:?}", watch.warnings, watch.losses);
        let on_cpu = reconstruct(&graph, &options, &mut Engine::Cpu, &mut watch);
        let auc = |outcome: &Outcome| compare(&outcome.reconstructions[0], &truth).auc_all.at_1;
        let (cpu, gpu) = (auc(&on_cpu), auc(&on_gpu));
        println!("{scene}: AUC@1 {cpu:.2} on the CPU, {gpu:.2} on the GPU");
        assert!((cpu - gpu).abs() <= 0.3, "{scene}: {cpu} {gpu}");
        // Single precision leaves its mark: the device did compute.
        assert_ne!(on_cpu.reconstructions[0].points[0].position, on_gpu.reconstructions[0].points[0].position);
    }
}

#[test]
fn a_device_lost_in_any_stage_is_told_and_costs_no_accuracy() {
    let folder = fixtures::folder().join("orbit");
    let graph = graph_of(&folder.join("database.db"));
    let truth: Reconstruction = read_model(&folder.join("truth")).expect("the truth").value;
    let auc = |outcome: &Outcome| compare(&outcome.reconstructions[0], &truth).auc_all.at_1;
    let cpu = auc(&reconstruct(&graph, &Options::default(), &mut Engine::Cpu, &mut Watch::default()));
    let Some(mut engine) = device() else { return };
    for stage in [Stage::Position, Stage::Refine, Stage::Retriangulate] {
        let mut watch = Watch { sabotage: engine.device().map(|device| (device, stage)), ..Watch::default() };
        let mut any = Engine::Gpu(engine);
        let outcome = reconstruct(&graph, &Options::default(), &mut any, &mut watch);
        let [Event::DeviceLost { stage: at, resumed_on: Some(_), message, .. }] = &watch.losses[..] else {
            panic!("{:?}", watch.losses)
        };
        assert_eq!(*at, stage);
        assert_eq!(outcome.report.warnings, std::slice::from_ref(message));
        assert_eq!(outcome.reconstructions[0].images.len(), truth.images.len());
        let gpu = auc(&outcome);
        println!("lost in {stage:?}: AUC@1 {cpu:.2} on the CPU, {gpu:.2} on the GPU");
        assert!((cpu - gpu).abs() <= 0.3, "{stage:?}: {cpu} {gpu}");
        let Engine::Gpu(next) = any else { panic!("still a device") };
        engine = next;
    }
}
