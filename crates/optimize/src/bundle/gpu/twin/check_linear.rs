//! Kernels of the linearisation and of the preconditioner against their twins.

use super::bench::{Bench, EXACT, compare, flat, square};
use super::coarse::check_coarse;
use super::num::{Bounded, Num};
use super::state::State;
use crate::bundle::gpu::records::OUT;
use crate::gpu::Turns;

/// A refresh from the state of the twins to that after it. What rounding decides is the device's to decide.
pub(super) fn check_refresh(bench: &Bench<'_>, twin: &State<f32>, exact: &State<Bounded>, after: &State<f32>) {
    let (mut t, mut e) = (twin.refresh(), exact.refresh());
    let found: Vec<f32> = after.residuals.iter().flat_map(|r| r[0]).collect();
    compare("refresh", &found, t.iter().flat_map(|t| t.errors), e.iter().flat_map(|e| e.errors));
    let mut uncertain = 0;
    for (o, (t, e)) in t.iter_mut().zip(&mut e).enumerate() {
        let counts = after.by_point[o].0 & OUT == 0;
        if counts != e.counts {
            assert!(e.margin < 1e-4, "observation {o}: {counts}, margin {}", e.margin);
            uncertain += 1;
        }
        (t.counts, e.counts) = (counts, counts);
    }
    assert!(uncertain <= 2, "{uncertain} decisions");
    let sums = bench.words(&bench.system.resident.buffers.trial_sums, 8 * twin.rows.len());
    compare(
        "its sums",
        sums.chunks(8).flat_map(|row| &row[..5]),
        flat(&twin.refresh_sums(&t)),
        flat(&exact.refresh_sums(&e)),
    );
}

pub(super) fn check_linearization(bench: &Bench<'_>) {
    let (twin, exact) = bench.twins();
    bench.run("refresh");
    let after = State::<f32>::download(&bench.system);
    check_refresh(bench, &twin, &exact, &after);

    bench.run("reweight");
    let (twin, exact) = bench.twins();
    let found: Vec<f32> = twin.by_point.iter().flat_map(|o| o.1).collect();
    compare("reweight", &found, flat(&twin.reweight()), flat(&exact.reweight()));
    assert!(twin.by_image.iter().all(|&(_, weights, index)| weights == twin.by_point[index].1));

    bench.run("linearize_point");
    let (twin, exact) = bench.twins();
    let (t, e) = (twin.normal_equations(), exact.normal_equations());
    let gradients: Vec<f32> = twin.blocks.iter().flat_map(|b| [b[2][0], b[2][1], b[2][2]]).collect();
    compare("J_pᵀr", &gradients, t.iter().flat_map(|t| t.1), e.iter().flat_map(|e| e.1));
    // R itself is as well determined as the point is; RᵀR is to rounding.
    for (block, (normal, _)) in twin.blocks.iter().zip(&e) {
        let three = |k: usize| std::array::from_fn(|j| f64::from(block[k][j]));
        let found = square(three(0), three(1));
        let scale = [normal[0].value, normal[3].value, normal[5].value].map(f64::sqrt);
        for (k, (i, j)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
            let error = (found[k] - normal[k].value).abs();
            assert!(error <= EXACT * scale[i] * scale[j] + 1e-30, "RᵀR: {found:?} {normal:?}");
        }
    }

    bench.run("linearize_camera");
    let (twin, exact) = bench.twins();
    let found: Vec<f32> = flat(&twin.partials).collect();
    compare("linearize_camera", &found, flat(&twin.linearize_camera()), flat(&exact.linearize_camera()));

    bench.run("scale_camera");
    let (twin, exact) = bench.twins();
    let found: Vec<f32> = (0..bench.units()).flat_map(|unit| twin.unit(0, unit)).collect();
    let inverse_root = |v: f32| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 };
    let exact_root = |v: Bounded| if v.value > 0.0 { Bounded::of(1.0) / v.root() } else { Bounded::of(0.0) };
    let (t, e) = (twin.column_norms(), exact.column_norms());
    compare("scale_camera", &found, flat(&t).map(inverse_root), flat(&e).map(exact_root));
    let found: Vec<f32> = (0..bench.units()).flat_map(|u| [twin.unit(8, u), twin.unit(9, u)]).flatten().collect();
    compare("its priors", &found, flat(&twin.scaled_priors()), flat(&exact.scaled_priors()));
}

pub(super) fn check_preconditioner(bench: &Bench<'_>) {
    let buffers = &bench.system.resident.buffers;
    let (before, _) = bench.twins();
    bench.run("damp_point");
    let (twin, exact) = bench.twins();
    for block in exact.blocks.iter().filter(|b| b[3][3].value == 1.0) {
        let three = |k: usize| std::array::from_fn(|j| block[k][j].value);
        let (top, bottom): ([f64; 3], [f64; 3]) = (three(4), three(5));
        let found = square([1.0 / top[0], top[1], top[2]], [1.0 / bottom[0], bottom[1], 1.0 / bottom[2]]);
        let mut wanted = square(three(0), three(1));
        for (k, at) in [0, 3, 5].into_iter().enumerate() {
            wanted[at] += f64::from(before.lambda) * block[3][k].value;
        }
        let scale = [wanted[0], wanted[3], wanted[5]].map(f64::sqrt);
        for (k, (i, j)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
            assert!((found[k] - wanted[k]).abs() <= EXACT * scale[i] * scale[j], "{found:?} {wanted:?}");
        }
    }
    let found: Vec<f32> = twin.points.iter().flat_map(|p| p.s).collect();
    compare("y₀", &found, flat(&twin.newton()), flat(&exact.newton()));

    bench.run("precondition_camera");
    let sizes = bench.system.layout.sizes;
    let found = bench.words(&buffers.block_sums, sizes.block_sums() * bench.system.layout.segments);
    let known = known_sums(&twin, &found);
    let (t, e) = (twin.precondition_camera(), exact.precondition_camera());
    compare("precondition_camera", &known, t.into_iter().flatten(), e.into_iter().flatten());

    bench.run("precondition_group");
    let layout = &bench.system.layout;
    let cameras: Vec<u32> = (0..layout.intrinsics.len() as u32).filter(|&c| twin.exact[c as usize]).collect();
    let chunks: Vec<_> = layout.chunks.iter().map(|c| c.first_point..c.first_point + c.points.len()).collect();
    let (t, e) = (twin.precondition_group(&chunks, &cameras), exact.precondition_group(&chunks, &cameras));
    let of_groups = bench.words(&buffers.group_sums, sizes.group_sums() * t.len());
    if !t.is_empty() {
        let has = |n: usize, k: usize| twin.has_param(cameras[n % cameras.len()] as usize, k);
        let known: Vec<f32> = (0..of_groups.len())
            .map(|at| (at / sizes.group_sums(), at % sizes.group_sums()))
            .map(|(n, k)| (n, has(n, k / sizes.params) && has(n, k % sizes.params), k))
            .map(|(n, known, k)| if known { of_groups[n * sizes.group_sums() + k] } else { 0.0 })
            .collect();
        compare("precondition_group", &known, t.concat(), e.concat());
    }

    bench.run("precondition_factor");
    let (twin, _) = bench.twins();
    check_inverses(&twin, &found, &|camera, k| {
        let which = cameras.iter().position(|&c| c as usize == camera);
        let slots = which.map(|which| of_groups.chunks(sizes.group_sums()).skip(which).step_by(cameras.len()));
        slots.into_iter().flatten().map(|sums| f64::from(sums[k])).sum()
    });

    check_coarse(bench);
    // Once with the second level and once without.
    if bench.system.layout.chunks.len() == 1 {
        let (system, resident) = (&bench.system, &bench.system.resident);
        let (turns, observer) = (Turns::default(), &mut ());
        let chunks = &system.layout.chunks;
        let made = system.coarse.assemble(system.device(), resident, chunks, || {}, &turns, observer);
        pollster::block_on(made).expect("a live device");
    }

    bench.run("pcg_start");
    let (after, _) = bench.twins();
    let (twin, exact) = bench.twins();
    let ((t, t_rz), (e, e_rz)) = (twin.pcg_start(), exact.pcg_start());
    let found: Vec<f32> = (0..bench.units()).flat_map(|unit| after.unit(5, unit)).collect();
    compare("pcg_start", &found, flat(&t), flat(&e));
    compare("rᵀz", &[after.vectors[0][2]], [t_rz], [e_rz]);
}

/// The sums of each segment, 0 where a parameter is not one of the model's.
fn known_sums(state: &State<f32>, block_sums: &[f32]) -> Vec<f32> {
    let side = state.sizes.side();
    let pairs = (0..side).flat_map(|i| (i..side).map(move |j| (i, j))).chain((0..side).map(|i| (i, i)));
    // The pose's own block.
    let pairs = pairs.chain([(0, 0); 21]);
    let pairs: Vec<_> = pairs.collect();
    let known = |segment: usize| {
        let camera = state.views[state.segments[segment][0] as usize].camera;
        let has = move |k: usize| k < 6 || state.has_param(camera, k - 6);
        let row = &block_sums[segment * state.sizes.block_sums()..];
        pairs.iter().zip(row).map(move |(&(i, j), &sum)| if has(i) && has(j) { sum } else { 0.0 })
    };
    (0..state.segments.len()).flat_map(known).collect()
}

/// Inverse times block is the identity, on the unknowns that move; and the right-hand side is the scaled sum.
fn check_inverses(state: &State<f32>, block_sums: &[f32], eliminated: &dyn Fn(usize, usize) -> f64) {
    let (images, units) = (state.images, state.images + state.cameras);
    let side = state.sizes.side();
    for unit in 0..units {
        let members: Vec<usize> = match unit.checked_sub(images) {
            None => vec![unit],
            Some(camera) => state.members(camera).iter().map(|&i| i as usize).collect(),
        };
        let camera = if unit < images { state.views[unit].camera } else { unit - images };
        let owned = state.members(camera).len() == 1;
        let (begin, end) = if unit >= images { (6, side) } else { (0, if owned { side } else { 6 }) };
        let scale =
            |k: usize| f64::from(if k < 6 { state.unit(0, unit)[k] } else { state.unit(0, images + camera)[k - 6] });
        let prior = |section: usize, k: usize| {
            f64::from(if k < 6 { state.unit(section, unit)[k] } else { state.unit(section, images + camera)[k - 6] })
        };
        let sum = |k: usize| -> f64 {
            let segments = members.iter().flat_map(|&i| state.segments_of(i));
            segments.map(|s| f64::from(block_sums[state.sizes.block_sums() * s + k])).sum()
        };
        let free: Vec<usize> = (begin..end).filter(|&k| scale(k) != 0.0).collect();
        for &i in &free {
            for &j in &free {
                let product: f64 = free
                    .iter()
                    .map(|&k| {
                        let (low, high) = (i.min(k), i.max(k));
                        let points = if unit >= images {
                            eliminated(camera, state.sizes.params * (low - 6) + high - 6)
                        } else {
                            0.0
                        };
                        let entry = scale(i) * scale(k) * (sum(side * low - low * (low + 1) / 2 + high) - points);
                        let damped = if i == k { entry + f64::from(state.lambda) + prior(8, i) } else { entry };
                        damped * f64::from(state.inverses[unit][side * k + j])
                    })
                    .sum();
                let wanted = if i == j { 1.0 } else { 0.0 };
                assert!((product - wanted).abs() < 2e-2, "unit {unit}, {i} {j}: {product}");
            }
            if !(unit >= images && owned) {
                let (at, k) = if i < 6 { (unit, i) } else { (images + camera, i - 6) };
                let (found, wanted) =
                    (f64::from(state.unit(1, at)[k]), scale(i) * sum(state.sizes.triangle() + i) - prior(9, i));
                assert!((found - wanted).abs() <= EXACT * (wanted.abs() + 1.0), "unit {unit}, {i}: {found} {wanted}");
            }
        }
    }
}
