//! Bundle adjustment with metric depth on a WebGPU device (lavapipe where there is no GPU), against the truth and the CPU.
#![cfg(feature = "gpu")]

mod common;

use common::device::{device, on_gpu, tight};
use common::extraction::{assert_monotone, clean, out_of_sight};
use common::metric::{depths, resize, scale, uneven_depths, wide};
use common::{Scene, perturb, ring};
use epipole_geometry::camera::CameraModel;
use epipole_optimize::Loss;
use epipole_optimize::active::Activation;
use epipole_optimize::bundle::gpu::{GpuSystem, Residency};
use epipole_optimize::bundle::{self, Depth, Options, PoseFreedom, Problem};
use epipole_optimize::lm::minimize;
use pollster::block_on;

#[test]
fn exact_depths_give_the_exact_scale() {
    let Some(device) = device() else { return };
    let fisheye = Scene {
        noise_px: 0.0,
        params: vec![420.0, 410.0, 500.0, 500.0, -0.02, 0.01, -0.003, 0.0005],
        refine: vec![0, 1],
        model: CameraModel::OpenCvFisheye,
        ..Scene::default()
    };
    for scene in [wide(), fisheye] {
        let truth = ring(&scene);
        let mut problem = truth.clone();
        resize(&mut problem, 1.1);
        perturb(&mut problem, 0.3, 0.02, 5);
        problem.depth = Some(depths(&truth, 3, |_| 1.0));
        on_gpu(&device, &mut problem, &tight(Activation::ValidAtStart));
        let error = scale(&problem, &truth) - 1.0;
        println!("{:?}: scale off by {error:.1e}", scene.model);
        assert!(error.abs() < 1e-4, "{error:e}");
    }
}

#[test]
fn reaches_the_optimum_of_f64_for_every_way_of_sharing_and_of_counting() {
    let Some(device) = device() else { return };
    let whole = Activation::ValidAtStart;
    let cases = [
        (true, vec![0, 3], whole),
        (false, vec![0, 3], whole),
        (true, vec![], whole),
        (true, vec![0, 3], Activation::DYNAMIC),
    ];
    for (shared, refine, activation) in cases {
        let mut truth = ring(&Scene { images: 40, points: 600, shared, refine, ..Scene::default() });
        truth.depth = Some(uneven_depths(&truth));
        truth.loss = Loss::Huber(1.0);
        // Depths leave a rigid motion free.
        truth.pose_freedom[0] = PoseFreedom::Fixed;
        perturb(&mut truth, 0.3, 0.02, 3);
        let (mut cpu, mut gpu) = (truth.clone(), truth);
        let options = tight(activation);
        let wanted = bundle::solve(&mut cpu, &options, &mut ()).expect("a good problem");
        let found = on_gpu(&device, &mut gpu, &options);
        let gap = found.final_cost / wanted.final_cost - 1.0;
        let apart = cpu.cam_from_world.iter().zip(&gpu.cam_from_world);
        let apart = apart.map(|(a, b)| (a.center() - b.center()).length()).fold(0.0, f64::max);
        println!("shared {shared} {activation:?}: gap {gap:.1e}, poses {apart:.1e}");
        assert!(gap.abs() < 1e-5 && found.active == wanted.active, "{gap} {found:?} {wanted:?}");
        assert!(apart < 1e-3 && (scale(&gpu, &cpu) - 1.0).abs() < 1e-4, "{apart} {}", scale(&gpu, &cpu));
    }
}

#[test]
fn points_out_of_sight_come_back_with_their_depths() {
    let Some(device) = device() else { return };
    let truth = clean();
    let mut start = out_of_sight();
    start.depth = Some(uneven_depths(&truth));
    let mut optimum = truth;
    optimum.depth = start.depth.clone();
    let options = tight(Activation::DYNAMIC);
    let wanted = bundle::solve(&mut optimum, &tight(Activation::ValidAtStart), &mut ()).expect("a good problem");
    let found = on_gpu(&device, &mut start, &options);
    assert_monotone(&found, 1e-6);
    assert!((found.final_cost / wanted.final_cost - 1.0).abs() < 1e-4, "{found:?} {wanted:?}");
    assert_eq!(found.active, start.observation_px.len());
}

#[test]
fn chunks_change_nothing_and_only_what_has_depth_pays_for_it() {
    let Some(device) = device() else { return };
    let mut problem = ring(&Scene { images: 40, points: 800, track: 8, ..Scene::default() });
    let depth = uneven_depths(&problem);
    perturb(&mut problem, 0.3, 0.02, 3);
    problem.loss = Loss::Huber(1.0);
    let bytes = |problem: &Problem| {
        let system = GpuSystem::new(&device, problem, &Options::default()).expect("a good problem");
        system.resident_bytes()
    };
    let without = bytes(&problem);
    // Depths of which none is known are no depths.
    problem.depth = Some(Depth::unknown(problem.observation_px.len()));
    assert_eq!(bytes(&problem), without);
    problem.depth = Some(depth);
    let with = bytes(&problem);
    println!("{} bytes an observation, {} with depth", without.per_observation(), with.per_observation());
    // Measured depth and weight, the residual at two states, a weight in the points' order; those by image have room.
    assert_eq!(with.per_observation() - without.per_observation(), 20.0);
    assert_eq!((with.point_bytes, with.rest_bytes), (without.point_bytes, without.rest_bytes));
    let mut costs = Vec::new();
    for residency in [Residency::default(), Residency { chunk_observations: 1000 }] {
        let options = tight(Activation::ValidAtStart);
        let mut system = GpuSystem::with_residency(&device, &problem, &options, &residency).expect("a good problem");
        let report = block_on(minimize(&mut system, &options.lm, &mut ()));
        assert!(report.accepted > 3);
        costs.push(block_on(system.write(&mut problem.clone())).expect("a live device"));
    }
    assert!((costs[1] / costs[0] - 1.0).abs() < 1e-6, "{costs:?}");
}

#[test]
fn wrong_depths_take_nothing_with_them_and_absurd_ones_are_refused_by_name() {
    let Some(device) = device() else { return };
    let truth = ring(&wide());
    let mut problem = truth.clone();
    perturb(&mut problem, 0.1, 0.01, 5);
    problem.loss = Loss::Huber(1.0);
    // A fifth of the depths is three times too long.
    problem.depth = Some(depths(&truth, 2, |k| if k % 5 == 0 { 3.0 } else { 1.0 }));
    for activation in [Activation::ValidAtStart, Activation::Truncated { residual_limit_px: 16.0 }] {
        let mut problem = problem.clone();
        let report = on_gpu(&device, &mut problem, &tight(activation));
        assert_eq!(report.active, truth.observation_image.len(), "{activation:?}: pixels are all good");
        assert!((scale(&problem, &truth) - 1.0).abs() < 1e-3, "{activation:?} {}", scale(&problem, &truth));
    }
    let mut depth = depths(&truth, 2, |_| 1.0);
    depth.weight[0] = 1e30;
    problem.depth = Some(depth);
    let error =
        block_on(bundle::gpu::solve(&device, &mut problem, &Options::default(), &mut ())).expect_err("too large");
    assert!(error.to_string().contains("1e15"), "{error}");
}
