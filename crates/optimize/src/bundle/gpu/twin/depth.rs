//! Every kernel with the row of inverse depths against its twins, whatever share of a point, an image or a chunk has depth;
//! and first steps against the CPU in `f64`.

use glam::DVec2;
use pollster::block_on;

use super::test::check;
use crate::active::Activation;
use crate::bundle::cpu::{CpuSystem, WITH_DEPTH};
use crate::bundle::gpu::{GpuSystem, Residency};
use crate::bundle::{Options, Solver};
use crate::common_for_tests as common;
use crate::common_for_tests::extraction::{clean, out_of_sight};
use crate::common_for_tests::metric::uneven_depths;
use crate::gpu::tests::device;
use crate::lm::System;
use crate::loss::Loss;
use crate::reduced::PcgOptions;

#[test]
fn kernels_agree_with_their_twins_on_one_shared_camera() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene { points: 500, ..common::Scene::default() });
    problem.depth = Some(uneven_depths(&problem));
    common::perturb(&mut problem, 0.3, 0.02, 3);
    problem.loss = Loss::Huber(1.0);
    check(&device, &problem);
}

#[test]
fn kernels_agree_with_their_twins_on_cameras_of_every_model_and_with_other_losses() {
    let Some(device) = device() else { return };
    let mut problem =
        common::ring(&common::Scene { images: 24, points: 500, shared: false, ..common::Scene::default() });
    common::mix_models(&mut problem, |_, _| true);
    problem.depth = Some(uneven_depths(&problem));
    common::perturb(&mut problem, 0.3, 0.02, 3);
    problem.loss = Loss::Cauchy(2.0);
    for loss in [Loss::GemanMcClure(3.0), Loss::Huber(3.0)] {
        problem.depth.iter_mut().for_each(|depth| depth.loss = loss);
        check(&device, &problem);
    }
}

/// Of a state: cost and how many count. Of a step from there: promised and found decrease, and the same of the next state.
async fn step(system: &mut impl System) -> ([f64; 4], [usize; 2]) {
    let before = system.refresh(&mut ()).await;
    system.linearize(&mut ()).await;
    let step = system.solve(1e-3, &mut ()).await.expect("a solution");
    let decrease = system.try_step().await.decrease;
    system.accept().await;
    let after = system.refresh(&mut ()).await;
    ([before.cost, step.predicted_decrease, decrease, after.cost], [before.active, after.active])
}

const ACTIVATIONS: [Activation; 4] =
    [Activation::ValidAtStart, Activation::All, Activation::Truncated { residual_limit_px: 12.0 }, Activation::DYNAMIC];

#[test]
fn a_step_is_that_of_the_cpu() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene { points: 500, ..common::Scene::default() });
    problem.depth = Some(uneven_depths(&problem));
    common::perturb(&mut problem, 0.3, 0.02, 3);
    problem.loss = Loss::Huber(1.0);
    // Converged, so that the step is one and not a matter of when PCG stops.
    let pcg = PcgOptions { eta: 1e-6, max_iterations: 300, ..PcgOptions::default() };
    for activation in ACTIVATIONS {
        let options = Options { activation, solver: Solver::Cholesky, pcg, ..Options::default() };
        let mut cpu = CpuSystem::<f64, WITH_DEPTH>::new(&problem, &options).expect("a good problem");
        let (wanted, wanted_active) = block_on(step(&mut cpu));
        for residency in [Residency::default(), Residency { chunk_observations: 1000 }] {
            let mut gpu = GpuSystem::with_residency(&device, &problem, &options, &residency).expect("a good problem");
            let (found, active) = block_on(step(&mut gpu));
            println!("{activation:?}: {found:?} for {wanted:?}, {active:?} for {wanted_active:?}");
            // What is left after the step has the error of the step.
            for (k, unit) in [wanted[0], wanted[1], wanted[2], wanted[0]].into_iter().enumerate() {
                assert!((found[k] - wanted[k]).abs() < 1e-5 * unit, "{activation:?} {k}");
            }
            assert_eq!(active, wanted_active);
        }
    }
}

#[test]
fn the_first_set_and_its_cost_are_those_of_the_cpu_also_where_depths_have_no_projection() {
    let Some(device) = device() else { return };
    let mut far = out_of_sight();
    far.depth = Some(uneven_depths(&clean()));
    // Behind its cameras, with a depth: it never counts and costs what a depth can cost at most.
    let mut near = common::ring(&common::Scene { points: 500, ..common::Scene::default() });
    near.points.push(near.cam_from_world[0].center() * 40.0);
    near.observation_image.extend([0, 0, 1]);
    near.observation_px.extend([DVec2::splat(500.0); 3]);
    near.track_start.push(near.observation_image.len() as u32);
    let mut depth = uneven_depths(&near);
    (near.observation_px.len() - 3..near.observation_px.len()).for_each(|o| depth.set(o, 2.0, 0.05));
    near.depth = Some(depth);
    for (name, problem, activations) in [("near", &near, &ACTIVATIONS[..]), ("far", &far, &ACTIVATIONS[2..])] {
        for &activation in activations {
            let options = Options { activation, ..Options::default() };
            let cpu = CpuSystem::<f64, WITH_DEPTH>::new(problem, &options).expect("a good problem");
            let mut gpu = GpuSystem::new(&device, problem, &options).expect("a good problem");
            let (mut cpu, found) = (cpu, block_on(gpu.refresh(&mut ())));
            let wanted = block_on(cpu.refresh(&mut ()));
            println!("{name} {activation:?}: {found:?} for {wanted:?}");
            assert!((found.cost / wanted.cost - 1.0).abs() < 1e-5, "{name} {activation:?}");
            assert!(found.active.abs_diff(wanted.active) <= 1, "{name} {activation:?}");
            let written = block_on(gpu.write(&mut problem.clone())).expect("a live device");
            assert!((written / wanted.cost - 1.0).abs() < 1e-5, "{name} {activation:?}: {written}");
        }
    }
}
