//! Kernels of PCG, of the step and of the gauge against their twins.

use super::model::ray_of;
use super::points::grouped;
use super::state::{Chunk, State};
use super::test::{Numbers, run, states};
use crate::bundle::gpu::twin::bench::{EXACT, compare, flat};
use crate::bundle::gpu::twin::num::{Bounded, Num, add, dot, scale, sub};
use crate::gpu::kernels::positioning as kernels;
use crate::positioning::gpu::processor::Gpu;
use crate::positioning::gpu::records::{Gauge, Stage};

pub(super) fn check_pcg(gpu: &Gpu<'_>) {
    for _ in 0..3 {
        run(gpu, kernels::PRODUCT_POINT);
        let (twin, exact) = states(gpu);
        let [mut y, mut sums] = std::array::from_fn(|_| Numbers::default());
        for (t, e) in twin.chunks.iter().zip(&exact.chunks) {
            let ((ty, ts), (ey, es)) = (twin.product_point(t), exact.product_point(e));
            y.found.extend(t.points.iter().flat_map(|p| p.s));
            y.expect(flat(&ty), flat(&ey));
            sums.found.extend(twin.sums[t.first_group..t.first_group + ts.len()].iter().map(|s| s[0]));
            sums.expect(flat(&ts), flat(&es));
        }
        y.check("product_point");
        sums.check("λ yᵀDy");

        run(gpu, kernels::PRODUCT_CAMERA);
        let (twin, exact) = states(gpu);
        let mut rows = Numbers::default();
        for (t, e) in twin.chunks.iter().zip(&exact.chunks) {
            rows.found.extend(flat(&twin.partials[t.first_segment..t.first_segment + t.segments.len()]));
            rows.expect(flat(&twin.product_camera(t)), flat(&exact.product_camera(e)));
        }
        rows.check("product_camera");

        let (before, exact) = states(gpu);
        run(gpu, kernels::PCG_STEP);
        let (after, _) = states(gpu);
        let (t, e) = (before.pcg_step(), exact.pcg_step());
        let found: Vec<f32> =
            (0..after.cameras).flat_map(|c| [1, 2, 3, 4].map(|section| after.vector(section, c)).concat()).collect();
        compare("pcg_step", &found, t.vectors.iter().flat_map(|v| flat(v)), e.vectors.iter().flat_map(|v| flat(v)));
        let scalars = [after.vectors[0][0], after.vectors[0][2], after.vectors[0][3], after.vectors[1][0]];
        compare("pcg scalars", &scalars, t.scalars, e.scalars);
        assert_eq!(after.vectors[0][1], 0.0, "η is zero: no stop before the limit");
    }
}

pub(super) fn check_step(gpu: &Gpu<'_>) {
    run(gpu, kernels::STEP_CAMERA);
    let (twin, exact) = states(gpu);
    fn tried<N: Num>(state: &State<N>) -> Vec<[N; 3]> {
        (0..state.cameras).map(|c| add(state.center(0, c), state.vector(1, c))).collect()
    }
    let found: Vec<f32> = (0..twin.cameras).flat_map(|c| twin.center(1, c)).collect();
    compare("step_camera", &found, flat(&tried(&twin)), flat(&tried(&exact)));
    let mut largest = [0.0f64; 3];
    for c in 0..exact.cameras {
        let (x, d, center) = (exact.vector(1, c), exact.vector(6, c), exact.center(1, c));
        for k in 0..3 {
            let candidates = [d[k].value.sqrt() * x[k].value, x[k].value, center[k].value].map(f64::abs);
            largest = std::array::from_fn(|i| largest[i].max(candidates[i]));
        }
    }
    for k in 0..3 {
        let found = f64::from(twin.vectors[1][1 + k]);
        assert!((found - largest[k]).abs() <= 1e-6 * largest[k], "{found} {largest:?}");
    }

    run(gpu, kernels::STEP_POINT);
    let (twin, exact) = states(gpu);
    let [mut positions, mut sums, mut costs] = std::array::from_fn(|_| Numbers::default());
    for (t, e) in twin.chunks.iter().zip(&exact.chunks) {
        let ((ts, t_rows), (es, e_rows)) = (twin.back_substitute(t), exact.back_substitute(e));
        let rows = &twin.sums[t.first_group..t.first_group + t_rows.len()];
        sums.found.extend(rows.iter().flat_map(|s| [s[4], s[5]]));
        sums.expect(flat(&t_rows), flat(&e_rows));
        costs.found.extend(rows.iter().flat_map(|s| [s[0], s[1], s[3]]));
        costs.expect(flat(&cost_rows(&twin, t)), flat(&cost_rows(&exact, e)));
        for p in 0..t.points.len() {
            if twin.settings.stage != Stage::Project || takes_its_step(&exact, e, p, es[p]) {
                positions.found.extend(t.points[p].s);
                positions.expect(add(t.points[p].x, ts[p]), add(e.points[p].x, es[p]));
            }
        }
    }
    positions.check("step_point");
    sums.check("its sums");
    costs.check("its costs");
}

/// By workgroup: decrease, cost after, observations that pull, at the positions that the kernel chose.
fn cost_rows<N: Num>(state: &State<N>, chunk: &Chunk<N>) -> Vec<[N; 3]> {
    grouped(chunk, |p| {
        let [after, pulling] = state.cost_at(chunk, p, chunk.points[p].s);
        [chunk.points[p].cost - after, after, pulling]
    })
}

/// Whether a point's step makes it cheaper. Where it does not, the kernel's choice must cost no more than half the step
/// and no step do.
fn takes_its_step(state: &State<Bounded>, chunk: &Chunk<Bounded>, p: usize, step: [Bounded; 3]) -> bool {
    let cost = |x| state.cost_at(chunk, p, x)[0];
    let point = &chunk.points[p];
    let stepped = cost(add(point.x, step));
    let margin = EXACT * (stepped.terms + point.cost.terms);
    if stepped.value < point.cost.value - margin {
        return true;
    }
    let chosen = cost(point.s).value;
    for share in [0.0, 0.5, 1.0] {
        let other = cost(add(point.x, scale(step, Bounded::of(share)))).value;
        let allowed = if stepped.value <= point.cost.value + margin { point.cost.value.max(other) } else { other };
        assert!(chosen <= allowed + margin, "point {p}: {chosen} against {other} for {share} of the step");
    }
    false
}

pub(super) fn check_gauge(gpu: &mut Gpu<'_>, gauge: Gauge) {
    gpu.settings.gauge = gauge;
    gpu.write_settings();
    let (before, exact) = states(gpu);
    if gauge != Gauge::Keep {
        run(gpu, kernels::SAMPLE);
        check_samples(gpu);
    }
    run(gpu, kernels::GAUGE);
    let (after, _) = states(gpu);
    let found = after.vectors[2].map(f64::from);
    let wanted = match gauge {
        Gauge::Keep => [0.0, 0.0, 0.0, 1.0],
        _ => {
            let sum = exact.by_camera(|c| exact.center(1, c));
            let factor = if gpu.settings.metric { 1.0 } else { 1.0 / upper_median(&after, 0) };
            let [x, y, z] = sum.map(|v| v.value / exact.cameras as f64);
            [x, y, z, factor]
        }
    };
    let size = (0..exact.cameras).flat_map(|c| exact.center(1, c)).map(|v| v.value.abs()).fold(0.0, f64::max);
    for k in 0..4 {
        let scale = if k < 3 { size } else { wanted[3] };
        assert!((found[k] - wanted[k]).abs() <= 1e-6 * scale, "{found:?} {wanted:?}");
    }
    let least = match gauge {
        Gauge::Keep => f64::from(before.vectors[3][0]),
        Gauge::Start => f64::from(gpu.settings.bound) * upper_median(&after, 1) / wanted[3],
        Gauge::Follow => f64::from(before.vectors[3][0]) / wanted[3],
    };
    let found = f64::from(after.vectors[3][0]);
    assert!((found - least).abs() <= 1e-6 * least, "{found} {least}");

    run(gpu, kernels::COMMIT_CAMERA);
    run(gpu, kernels::COMMIT_POINT);
    let (done, _) = states(gpu);
    let mut all = Numbers::default();
    fn commit<N: Num>(state: &State<N>, x: [N; 3]) -> [N; 3] {
        let [a, b, c, factor] = state.vectors[2];
        scale(sub(x, [a, b, c]), factor)
    }
    let (twin, exact) = states(gpu);
    all.found.extend((0..done.cameras).flat_map(|c| done.center(0, c)));
    all.expect(
        (0..done.cameras).flat_map(|c| commit(&twin, twin.center(1, c))),
        (0..done.cameras).flat_map(|c| commit(&exact, exact.center(1, c))),
    );
    for (t, e) in twin.chunks.iter().zip(&exact.chunks) {
        all.found.extend(t.points.iter().flat_map(|p| p.x));
        all.expect(t.points.iter().flat_map(|p| commit(&twin, p.s)), e.points.iter().flat_map(|p| commit(&exact, p.s)));
    }
    all.check("commit");
}

fn check_samples(gpu: &Gpu<'_>) {
    let (twin, exact) = states(gpu);
    fn lengths<N: Num>(state: &State<N>) -> Vec<[N; 2]> {
        let chunks = state.chunks.iter();
        let all = chunks.flat_map(|chunk| chunk.samples.iter().map(move |s| (chunk, s.map(|v| v as usize))));
        all.map(|(chunk, [point, camera, ray, _])| {
            let d = sub(chunk.points[point].s, state.center(1, camera));
            let (direction, _) = ray_of(chunk.rays[ray]);
            let best = dot(&direction, &d) / dot(&d, &d);
            [dot(&d, &d).root(), if best.value() > 0.0 { best } else { N::of(-1.0) }]
        })
        .collect()
    }
    let found: Vec<f32> = flat(&twin.lengths).collect();
    compare("sample", &found, flat(&lengths(&twin)), flat(&lengths(&exact)));
}

/// The upper median of the values above zero in a column of the samples.
fn upper_median(state: &State<f32>, column: usize) -> f64 {
    let mut values: Vec<f32> = state.lengths.iter().map(|l| l[column]).filter(|&v| v > 0.0).collect();
    values.sort_by(f32::total_cmp);
    f64::from(values[values.len() / 2])
}
