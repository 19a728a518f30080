//! The pipeline on a WebGPU device (lavapipe where there is no GPU) ends where it ends on the CPU, also when the device is
//! lost on the way. `cargo xtask bench backends` does the same for every scene of the goal.
#![cfg(feature = "gpu")]

mod common;

use std::rc::Rc;

use common::{check_consistent, compare};
use epipole_formats::depth::attach_depths;
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

/// Pins in positioning, rows in bundle adjustment, the maps judged against the reconstruction in between: all on the device.
#[test]
fn depth_maps_make_a_scene_as_metric_as_on_the_cpu() {
    let Some(device) = device() else { return };
    let mut engine = Engine::Gpu(device);
    let folder = fixtures::folder().join("orbit");
    let truth: Reconstruction = read_model(&folder.join("truth")).expect("the truth").value;
    for is_affine in [false, true] {
        let mut options = Options::default();
        options.metric.affine = is_affine;
        let mut graph = graph_of(&folder.join("database.db"));
        attach_depths(&mut graph, &folder.join("depth"), None, &options.depth, &mut |_, _| true).expect("depth maps");
        let mut watch = Watch::default();
        let on_gpu = reconstruct(&graph, &options, &mut engine, &mut watch);
        assert!(watch.warnings.is_empty() && watch.losses.is_empty(), "{:?} {:?}", watch.warnings, watch.losses);
        let on_cpu = reconstruct(&graph, &options, &mut Engine::Cpu, &mut watch);
        let (cpu, gpu) = (&on_cpu.reconstructions[0], &on_gpu.reconstructions[0]);
        assert_ne!(cpu.points[0].position, gpu.points[0].position, "the device did compute");
        let scale_error = |model| compare(model, &truth).scale_error.expect("enough images");
        let apart = compare(gpu, cpu);
        let rigid = apart.ate_rigid.expect("enough images").rmse / apart.reference_extent;
        println!("scale {:+.4} % on the CPU, {:+.4} % on the GPU", 100.0 * scale_error(cpu), 100.0 * scale_error(gpu));
        println!("centres apart by {rigid:.1e} of the extent");
        assert!(on_gpu.report.components[0].metric.is_some() && on_cpu.report.components[0].metric.is_some());
        assert!((scale_error(cpu) - scale_error(gpu)).abs() < 1e-4 && rigid < 1e-4);
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
