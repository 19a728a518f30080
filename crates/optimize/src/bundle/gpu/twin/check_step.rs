//! Kernels of PCG, of the step and of the trial against their twins.

use glam::{DMat3, DQuat, DVec3};

use super::bench::{Bench, compare, flat};
use super::num::Bounded;
use super::state::View;

pub(super) fn check_pcg(bench: &Bench<'_>) {
    for _ in 0..3 {
        bench.run("product_point");
        let (twin, exact) = bench.twins();
        let ((t, t_sums), (e, e_sums)) = (twin.product_point(), exact.product_point());
        let found: Vec<f32> = twin.points.iter().flat_map(|p| p.s).collect();
        compare("product_point", &found, flat(&t), flat(&e));
        let found: Vec<f32> = twin.product_sums.iter().map(|s| s[0]).collect();
        compare("λ‖y‖²", &found, flat(&t_sums), flat(&e_sums));

        bench.run("product_camera");
        let (twin, exact) = bench.twins();
        let found: Vec<f32> = flat(&twin.partials).collect();
        compare("product_camera", &found, flat(&twin.product_camera()), flat(&exact.product_camera()));

        bench.run("pcg_step");
        let (after, _) = bench.twins();
        let (t, e) = (twin.pcg_step(), exact.pcg_step());
        let sections = [2, 3, 4, 5];
        let found: Vec<f32> = (0..bench.units()).flat_map(|u| sections.map(|s| after.unit(s, u))).flatten().collect();
        compare(
            "pcg_step",
            &found,
            t.units.iter().flatten().flatten().copied(),
            e.units.iter().flatten().flatten().copied(),
        );
        let scalars = [after.vectors[0][0], after.vectors[0][2], after.vectors[0][3], after.vectors[1][0]];
        compare("pcg scalars", &scalars, t.scalars, e.scalars);
    }
}

pub(super) fn check_cameras(bench: &Bench<'_>) {
    bench.run("step_camera");
    bench.run("change_camera");
    bench.run("prior_camera");
    let (twin, state) = bench.twins();
    let found = [twin.vectors[1][2], twin.vectors[1][3]];
    compare("prior_camera", &found, twin.prior_camera(), state.prior_camera());
    let (images, cameras) = (state.images, state.cameras);
    let cell = state.cell.value;
    for i in 0..images {
        let (before, after, change) = (&state.views[i], &state.views[i + images], &state.views[i + 2 * images]);
        let (s, x) = (state.unit(0, i), state.unit(2, i));
        let step: [f64; 6] = std::array::from_fn(|k| s[k].value * x[k].value);
        let matrix =
            |v: &View<Bounded>| DMat3::from_cols_array_2d(&v.rotation.map(|row| row.map(|n| n.value))).transpose();
        let wanted = matrix(before) * DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2])));
        assert!(matrix(after).abs_diff_eq(wanted, 1e-6), "image {i}");
        assert!((matrix(after) * matrix(after).transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-6));
        // Differences of nearby numbers are exact; of a large step they are rounded.
        let turn = DVec3::new(step[0], step[1], step[2]).length();
        assert!(matrix(change).abs_diff_eq(matrix(after) - matrix(before), 1e-9 + 1e-7 * turn), "image {i}: {turn}");
        for k in 0..3 {
            let position = |v: &View<Bounded>| cell * f64::from(v.cell[k]) + v.center[k].value;
            let moved = position(after) - position(before);
            assert!((moved - step[3 + k]).abs() < 1e-6 * cell, "image {i}: {moved} {}", step[3 + k]);
            assert!((change.center[k].value - moved).abs() < 1e-6 * cell && after.center[k].value.abs() <= cell);
        }
    }
    for c in 0..cameras {
        for k in 0..state.sizes.params {
            let of = |block: usize| state.intrinsics[c + block * cameras][k].value;
            let slot = if k == 1 && state.single_focal[c] { 0 } else { k };
            let step = state.unit(0, images + c)[slot].value * state.unit(2, images + c)[slot].value;
            let size = of(0).abs() + of(1).abs();
            assert!((of(1) - of(0) - step).abs() <= 1e-6 * size + 1e-7, "camera {c}, parameter {k}");
            assert!((of(2) - (of(1) - of(0))).abs() <= 1e-7 * (of(1) - of(0)).abs());
        }
    }
}

pub(super) fn check_trial(bench: &Bench<'_>) {
    let resident = &bench.system.resident;
    let buffers = &resident.buffers;
    let (twin, exact) = bench.twins();
    bench.run("back_substitute");
    let (after, _) = bench.twins();
    let ((t, t_sums), (e, e_sums)) = (twin.back_substitute(), exact.back_substitute());
    let found: Vec<f32> = after.points.iter().flat_map(|p| p.s).collect();
    compare("back_substitute", &found, flat(&t), flat(&e));
    let sums = bench.words(&buffers.step_sums, 8 * resident.params.point_groups as usize);
    compare("its sums", sums.chunks(8).flat_map(|row| &row[..2]), flat(&t_sums), flat(&e_sums));

    bench.run("change_point");
    let (twin, exact) = bench.twins();
    assert!(twin.points.iter().zip(&twin.changes).all(|(p, c)| (0..3).all(|k| c[k] == p.s[k] - p.offset[k])));

    bench.run("trial");
    let (after, _) = bench.twins();
    let ((t, t_sums), (e, e_sums)) = (twin.trial(), exact.trial());
    let found: Vec<f32> = after.residuals.iter().flat_map(|r| r[1]).collect();
    compare("trial", &found, flat(&t), flat(&e));
    let sums = bench.words(&buffers.trial_sums, 8 * resident.params.point_groups as usize);
    compare("its sums", sums.chunks(8).flat_map(|row| &row[..5]), flat(&t_sums), flat(&e_sums));

    bench.run("commit_camera");
    bench.run("commit_point");
    let (_, done) = bench.twins();
    let cell = done.cell.value;
    for (p, (before, now)) in after.points.iter().zip(&done.points).enumerate() {
        for k in 0..3 {
            let tried = f64::from(before.s[k]) + cell * f64::from(before.cell[k]);
            assert_eq!(tried, now.offset[k].value + cell * f64::from(now.cell[k]), "point {p}");
        }
    }
    for (o, (before, now)) in after.residuals.iter().zip(&done.residuals).enumerate() {
        let left = before[1][0] == super::sight::INVALID;
        let kept = if left { before[0] } else { before[1] };
        assert_eq!(kept.map(f64::from), now[0].map(|n| n.value));
        assert_eq!(done.by_point[o].0 >> 31 == 1, left || after.by_point[o].0 >> 31 == 1);
    }
}
