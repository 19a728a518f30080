//! The truncated objective on a device against its twins: the first set, points that are triangulated again, observations
//! that are hidden and return, a step that leaves some behind, with depths and without.

use pollster::block_on;

use super::bench::{Bench, compare, flat};
use super::check_linear::check_refresh;
use super::num::Bounded;
use super::state::State;
use crate::active::Activation;
use crate::bundle::gpu::records::{FIRST_PASS, FROM_SCRATCH, OUT};
use crate::bundle::gpu::{GpuSystem, Residency};
use crate::bundle::{Options, Problem};
use crate::common_for_tests::extraction::{clean, out_of_sight};
use crate::common_for_tests::metric::uneven_depths;
use crate::common_for_tests::{Scene, mix_models, perturb, ring};
use crate::gpu::Device;
use crate::gpu::tests::device;
use crate::lm::System;

const LIMIT_PX: f64 = 60.0;

/// Runs a refresh with flags and compares.
fn refresh(bench: &mut Bench<'_>, flags: u32) {
    bench.system.prepare((LIMIT_PX * LIMIT_PX) as f32, flags);
    let (twin, exact) = bench.twins();
    bench.run("refresh");
    check_refresh(bench, &twin, &exact, &State::download(&bench.system));
}

/// Looks at every point that misses an observation; returns how many moved.
fn check_revive(bench: &mut Bench<'_>) -> usize {
    bench.system.resident.params.revive_all = true;
    bench.system.resident.write_params(bench.system.device());
    let (twin, exact) = bench.twins();
    bench.run("revive");
    let (after, after_exact): (State<f32>, State<Bounded>) = bench.twins();
    let (t, e) = (twin.revive(), exact.revive());
    let (mut moved, mut apart, mut uncertain) = (0, 0, 0);
    for p in 0..after.points.len() {
        let has_moved = after.points[p].offset != twin.points[p].offset || after.points[p].cell != twin.points[p].cell;
        let (Some(t), Some(e)) = (t[p], e[p]) else {
            assert!(!has_moved && t[p].is_none() && e[p].is_none(), "point {p} was not to be looked at");
            continue;
        };
        let gain = (e.before - e.best).value;
        if has_moved != (gain > 0.0) {
            assert!(gain.abs() < 1e-4 * e.before.value.abs(), "point {p}: {gain} of {}", e.before.value);
            uncertain += 1;
            continue;
        }
        if !has_moved {
            assert_eq!(after.residuals[after.track(p)], twin.residuals[twin.track(p)]);
            continue;
        }
        moved += 1;
        // It costs what was found, and lies where the twin puts it.
        let cost: f64 = exact
            .track(p)
            .filter(|&o| exact.by_point[o].0 >> 30 & 1 == 0)
            .map(|o| exact.charge(o, exact.errors(o, &after_exact.points[p])).value)
            .sum();
        assert!(cost <= e.best.value + 1e-3 * e.before.value, "point {p}: {cost} for {}", e.best.value);
        let from_center = after.ray(&after.points[p], &after.views[t.origin]);
        let off = (0..3).map(|k| f64::from(from_center[k] - t.from_center[k]).abs()).fold(0.0, f64::max);
        apart += usize::from(off > 1e-4 * f64::from(after.cell));
    }
    println!("{moved} points moved, {apart} of them elsewhere, {uncertain} near the least gain");
    assert!(10 * apart <= moved && uncertain <= 2);
    // The errors of what moved are those of the new place.
    let found: Vec<usize> = (0..after.points.len())
        .filter(|&p| after.points[p].offset != twin.points[p].offset)
        .flat_map(|p| after.track(p).map(move |o| (p, o)))
        .filter(|&(p, o)| after_exact.errors(o, &after_exact.points[p]).is_some() && after.residuals[o][0][0] < 1e29)
        .map(|(_, o)| o)
        .collect();
    let point_of = |o: usize| after.tracks.partition_point(|&start| start as usize <= o) - 1;
    compare(
        "revive",
        found.iter().flat_map(|&o| &after.residuals[o][0]),
        found.iter().flat_map(|&o| after.errors(o, &after.points[point_of(o)]).unwrap_or([f32::NAN; 3])),
        found.iter().flat_map(|&o| after_exact.errors(o, &after_exact.points[point_of(o)]).unwrap_or_default()),
    );
    moved
}

/// Tries every seventh point far to the side, beyond many of the cameras that see it, and all else where it is.
fn throw_points(bench: &Bench<'_>) {
    let system = &bench.system;
    for (chunk, buffers) in system.layout.chunks.iter().zip(&system.resident.chunks) {
        let download = system.device().download::<f32>(&buffers.points, 8 * chunk.points.len());
        let mut words = block_on(download).expect("a live device");
        for (p, record) in words.chunks_exact_mut(8).enumerate() {
            record.copy_within(..3, 4);
            record[4] += if p % 7 == 0 { 40.0 * system.resident.params.cell } else { 0.0 };
        }
        system.device().write(&buffers.points, &words);
    }
    bench.dispatch("change_camera");
    bench.dispatch("change_point");
    bench.dispatch("trial");
}

/// Compares a trial that was run; returns how many observations fall behind their cameras.
fn check_trial(bench: &Bench<'_>) -> f32 {
    let (twin, exact) = bench.twins();
    let ((t, t_sums), (e, e_sums)) = (twin.trial(), exact.trial());
    compare("trial", twin.residuals.iter().flat_map(|r| &r[1]), flat(&t), flat(&e));
    let sums = bench.words(&bench.system.resident.buffers.trial_sums, 8 * twin.rows.len());
    compare("its sums", sums.chunks(8).flat_map(|row| &row[..5]), flat(&t_sums), flat(&e_sums));
    t_sums.iter().map(|sums| sums[2]).sum()
}

fn check(device: &Device, problem: &Problem) {
    for residency in [Residency::default(), Residency { chunk_observations: 1000 }] {
        let options =
            Options { activation: Activation::Truncated { residual_limit_px: LIMIT_PX }, ..Options::default() };
        let mut system = GpuSystem::with_residency(device, problem, &options, &residency).expect("a good problem");
        // The twins do not follow observations that are moved.
        system.membership.compact_share = 1.0;
        let mut bench = Bench { system };
        refresh(&mut bench, FIRST_PASS);
        let out = |bench: &Bench<'_>| bench.twins().0.by_point.iter().filter(|o| o.0 & OUT != 0).count();
        let first = out(&bench);
        block_on(bench.system.occlude(|image, point| (7 * image + point) % 11 == 0)).expect("a live device");
        refresh(&mut bench, 0);
        assert!(first > 100 && out(&bench) > first, "{first} {}", out(&bench));
        let moved = check_revive(&mut bench);
        assert!(moved > 20, "{moved}");
        block_on(bench.system.occlude(|_, _| false)).expect("a live device");
        refresh(&mut bench, 0);
        assert!(out(&bench) < first, "{first} {}", out(&bench));

        block_on(bench.system.linearize(&mut ()));
        assert!(block_on(bench.system.solve(1e-4, &mut ())).is_some());
        check_trial(&bench);
        block_on(bench.system.accept());
        refresh(&mut bench, 0);
        refresh(&mut bench, FROM_SCRATCH);
        throw_points(&bench);
        assert!(check_trial(&bench) > 20.0);
    }
}

#[test]
fn sets_revived_points_and_trials_agree_with_their_twins() {
    let Some(device) = device() else { return };
    let mut problem = out_of_sight();
    check(&device, &problem);
    problem.depth = Some(uneven_depths(&clean()));
    check(&device, &problem);
}

#[test]
fn sets_revived_points_and_trials_agree_with_their_twins_for_cameras_of_every_model() {
    let Some(device) = device() else { return };
    let mut problem = ring(&Scene { images: 24, points: 500, shared: false, ..Scene::default() });
    mix_models(&mut problem, |_, _| false);
    problem.depth = Some(uneven_depths(&problem));
    perturb(&mut problem, 0.3, 0.02, 3);
    for p in (0..problem.points.len()).step_by(4) {
        problem.points[p] *= -1.5;
    }
    check(&device, &problem);
}
