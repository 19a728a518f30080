//! Kernels of the linearisation and of the preconditioner against their twins.

use super::points::{damping, gradient, grouped, solve_block};
use super::state::State;
use super::test::{Numbers, run, states};
use crate::bundle::gpu::twin::bench::{EXACT, compare, flat, square};
use crate::bundle::gpu::twin::num::{Bounded, Num};
use crate::gpu::kernels::positioning as kernels;
use crate::positioning::gpu::processor::Gpu;

/// Where the entries 00 01 02 11 12 22 are.
const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// A normal matrix to rounding: R itself is only as well determined as the point is.
fn check_normal(found: [f64; 6], wanted: [f64; 6]) {
    let scale = [wanted[0], wanted[3], wanted[5]].map(f64::sqrt);
    for (k, (i, j)) in PLACES.into_iter().enumerate() {
        let error = (found[k] - wanted[k]).abs();
        assert!(error <= EXACT * scale[i] * scale[j] + 1e-30, "RᵀR: {found:?} {wanted:?}");
    }
}

pub(super) fn check_linearization(gpu: &Gpu<'_>) {
    run(gpu, kernels::LINEARIZE);
    let (twin, exact) = states(gpu);
    let [mut kept, mut costs, mut gradients, mut sums] = std::array::from_fn(|_| Numbers::default());
    for (c, x) in twin.chunks.iter().zip(&exact.chunks) {
        let (t, e) = (twin.linearize(c), exact.linearize(x));
        kept.found.extend(c.by_point.iter().map(|o| o.1));
        kept.expect(t.iter().flat_map(|t| t.kept.clone()), e.iter().flat_map(|e| e.kept.clone()));
        costs.found.extend(c.points.iter().map(|p| p.cost));
        costs.expect(t.iter().map(|t| t.cost), e.iter().map(|e| e.cost));
        gradients.found.extend(c.blocks.iter().flat_map(gradient));
        gradients.expect(t.iter().flat_map(|t| t.gradient), e.iter().flat_map(|e| e.gradient));
        let groups = c.points.len().div_ceil(64);
        sums.found.extend(twin.sums[c.first_group..c.first_group + groups].iter().flat_map(|s| [s[1], s[3]]));
        let (a, b) = (grouped(c, |p| [t[p].cost, t[p].pulling]), grouped(x, |p| [e[p].cost, e[p].pulling]));
        sums.expect(flat(&a), flat(&b));
        for (block, e) in c.blocks.iter().zip(&e) {
            let three = |k: usize| std::array::from_fn(|j| f64::from(block[k][j]));
            check_normal(square(three(0), three(1)), e.normal.map(|n| n.value));
        }
    }
    kept.check("linearize");
    costs.check("its costs");
    gradients.check("its gradients");
    sums.check("its sums");

    run(gpu, kernels::SPREAD);
    let (state, _) = states(gpu);
    for chunk in &state.chunks {
        assert!(chunk.by_camera.iter().all(|&(_, kept, index)| kept == chunk.by_point[index].1));
    }
}

pub(super) fn check_preconditioner(gpu: &Gpu<'_>) {
    run(gpu, kernels::DAMP);
    let (twin, exact) = states(gpu);
    let mut steps = Numbers::default();
    for (t, e) in twin.chunks.iter().zip(&exact.chunks) {
        steps.found.extend(t.points.iter().flat_map(|p| p.s));
        let alone = |b| solve_block(b, gradient(b));
        steps.expect(t.blocks.iter().flat_map(alone), e.blocks.iter().flat_map(|b| solve_block(b, gradient(b))));
        for block in e.blocks.iter().filter(|b| b[2][0].value != 0.0) {
            let three = |k: usize| std::array::from_fn(|j| block[k][j].value);
            let (top, bottom): ([f64; 3], [f64; 3]) = (three(2), three(3));
            let found = square([1.0 / top[0], top[1], top[2]], [1.0 / bottom[0], bottom[1], 1.0 / bottom[2]]);
            let mut wanted = square(three(0), three(1));
            for (at, d) in [0, 3, 5].into_iter().zip(damping(block)) {
                wanted[at] += exact.lambda().value * d.value;
            }
            check_normal(found, wanted);
        }
    }
    steps.check("y₀");

    run(gpu, kernels::PRECONDITION);
    let (twin, exact) = states(gpu);
    let mut sums = Numbers::default();
    for (t, e) in twin.chunks.iter().zip(&exact.chunks) {
        let rows = &twin.block_sums[t.first_segment..t.first_segment + t.segments.len()];
        sums.found.extend(flat(rows));
        sums.expect(flat(&twin.precondition_sums(t)), flat(&exact.precondition_sums(e)));
    }
    sums.check("precondition");

    run(gpu, kernels::FACTOR);
    let (twin, exact) = states(gpu);
    let all = 0..twin.cameras;
    let found: Vec<f32> = all.clone().flat_map(|c| [twin.vector(0, c), twin.vector(6, c)].concat()).collect();
    fn wanted<N: Num>(state: &State<N>, camera: usize) -> Vec<N> {
        let sum = state.block_sum(camera);
        [[sum[6], sum[7], sum[8]], state.diagonal(camera)].concat()
    }
    compare("factor", &found, all.clone().flat_map(|c| wanted(&twin, c)), all.clone().flat_map(|c| wanted(&exact, c)));
    all.for_each(|camera| check_inverse(&exact, camera));

    run(gpu, kernels::PCG_START);
    let (twin, exact) = states(gpu);
    let ((t, t_rz), (e, e_rz)) = (twin.pcg_start(), exact.pcg_start());
    let found: Vec<f32> = (0..twin.cameras).flat_map(|camera| twin.vector(4, camera)).collect();
    compare("pcg_start", &found, flat(&t), flat(&e));
    compare("rᵀz", &[twin.vectors[0][2]], [t_rz], [e_rz]);
}

/// Inverse times block is the identity; zero for a camera that nothing pulls.
fn check_inverse(state: &State<Bounded>, camera: usize) {
    let (sum, d) = (state.block_sum(camera), state.diagonal(camera));
    let (t, b) = (state.vector(7, camera), state.vector(8, camera));
    let full = |v: [Bounded; 6]| {
        let v = v.map(|n| n.value);
        [[v[0], v[1], v[2]], [v[1], v[3], v[4]], [v[2], v[4], v[5]]]
    };
    let mut block = full(std::array::from_fn(|k| sum[k]));
    (0..3).for_each(|k| block[k][k] += state.lambda().value * d[k].value);
    let inverse = full([t[0], t[1], t[2], b[0], b[1], b[2]]);
    for i in 0..3 {
        for j in 0..3 {
            let product: f64 = (0..3).map(|k| block[i][k] * inverse[k][j]).sum();
            let wanted = if i == j && d[0].value > 0.0 { 1.0 } else { 0.0 };
            // Rounding of the block, times its condition.
            assert!((product - wanted).abs() < 1e-3, "camera {camera}: {product} at {i} {j}");
        }
    }
}
