//! Twins of the kernels that walk tracks, one point an invocation.

use super::model::{Linear, Row};
use super::state::{Block, Chunk, State};
use crate::bundle::gpu::twin::num::{Num, Vec3, add, dot, scale, sub, tree, zero};

/// As in `block.wgsl`.
const DIAGONAL_FLOOR: f32 = 1e-6;

/// `v R̃⁻¹`.
pub(super) fn solve_row<N: Num>(block: &Block<N>, v: Vec3<N>) -> Vec3<N> {
    let (top, bottom) = (block[2], block[3]);
    let a = v[0] * top[0];
    let b = (v[1] - a * top[1]) * bottom[0];
    [a, b, (v[2] - a * top[2] - b * bottom[1]) * bottom[2]]
}

/// `(R̃ᵀR̃)⁻¹ g`.
pub(super) fn solve_block<N: Num>(block: &Block<N>, g: Vec3<N>) -> Vec3<N> {
    let (top, bottom) = (block[2], block[3]);
    let y = solve_row(block, g);
    let c = y[2] * bottom[2];
    let b = (y[1] - bottom[1] * c) * bottom[0];
    [(y[0] - top[1] * b - top[2] * c) * top[0], b, c]
}

pub(super) fn gradient<N: Num>(block: &Block<N>) -> Vec3<N> {
    [block[0][3], block[1][3], block[2][3]]
}

pub(super) fn floored<N: Num>(d: Vec3<N>) -> Vec3<N> {
    let floor = N::of(DIAGONAL_FLOOR) * (d[0] + d[1] + d[2]);
    d.map(|v| if v.value() > floor.value() { v } else { floor })
}

/// What λ multiplies.
pub(super) fn damping<N: Num>(block: &Block<N>) -> Vec3<N> {
    let (t, b) = (block[0], block[1]);
    floored([t[0] * t[0], t[1] * t[1] + b[0] * b[0], t[2] * t[2] + b[1] * b[1] + b[2] * b[2]])
}

/// What `linearize` finds for a point: its observations, and the sum of their blocks (00 01 02 11 12 22).
pub(super) struct PointSums<N> {
    pub(super) kept: Vec<N>,
    pub(super) cost: N,
    pub(super) pulling: N,
    pub(super) gradient: Vec3<N>,
    pub(super) normal: [N; 6],
}

impl<N: Num> State<N> {
    fn difference(&self, chunk: &Chunk<N>, x: Vec3<N>, block: usize, o: usize) -> Vec3<N> {
        sub(x, self.center(block, chunk.by_point[o].0))
    }

    fn linear_at(&self, chunk: &Chunk<N>, x: Vec3<N>, block: usize, o: usize) -> Linear<N> {
        let weight = self.centers[chunk.by_point[o].0][3];
        self.linear(chunk.rays[o], weight, self.difference(chunk, x, block, o))
    }

    fn row_at(&self, chunk: &Chunk<N>, p: usize, o: usize) -> Row<N> {
        let d = self.difference(chunk, chunk.points[p].x, 0, o);
        self.row(chunk.by_point[o].1, d, chunk.rays[o])
    }

    pub(super) fn linearize(&self, chunk: &Chunk<N>) -> Vec<PointSums<N>> {
        let one = |p: usize| {
            let mut out =
                PointSums { kept: vec![], cost: N::of(0.0), pulling: N::of(0.0), gradient: zero(), normal: zero() };
            for o in chunk.track(p) {
                let found = self.linear_at(chunk, chunk.points[p].x, 0, o);
                out.kept.push(found.row.kept());
                out.cost += found.cost;
                out.pulling += N::of(f32::from(u8::from(found.pulls)));
                out.gradient = add(out.gradient, found.gradient);
                let columns: [Vec3<N>; 3] = std::array::from_fn(|k| {
                    found.row.block(std::array::from_fn(|j| N::of(f32::from(u8::from(j == k)))))
                });
                let [a, b, c] = columns;
                out.normal = add(out.normal, [a[0], a[1], a[2], b[1], b[2], c[2]]);
            }
            out
        };
        (0..chunk.points.len()).map(one).collect()
    }

    /// `Σ A A p` over a track, for steps of the cameras.
    fn pulled(&self, chunk: &Chunk<N>, p: usize, start: Vec3<N>, section: usize) -> Vec3<N> {
        chunk.track(p).fold(start, |sum, o| {
            let step = self.vector(section, chunk.by_point[o].0);
            add(sum, self.row_at(chunk, p, o).block(step))
        })
    }

    /// By point: y; by workgroup: λ yᵀDy.
    pub(super) fn product_point(&self, chunk: &Chunk<N>) -> (Vec<Vec3<N>>, Vec<[N; 1]>) {
        let solve = |p: usize| solve_block(&chunk.blocks[p], self.pulled(chunk, p, zero(), 4));
        let y: Vec<_> = (0..chunk.points.len()).map(solve).collect();
        let squares = |p: usize| {
            let d = damping(&chunk.blocks[p]);
            [self.lambda() * dot(&[d[0] * y[p][0], d[1] * y[p][1], d[2] * y[p][2]], &y[p])]
        };
        let sums = grouped(chunk, squares);
        (y, sums)
    }

    /// By point: its step; by workgroup: `gᵀ(R̃ᵀR̃)⁻¹g` and `δXᵀDδX`.
    pub(super) fn back_substitute(&self, chunk: &Chunk<N>) -> (Vec<Vec3<N>>, Vec<[N; 2]>) {
        let minus = |p: usize| scale(gradient(&chunk.blocks[p]), N::of(-1.0));
        let solve = |p: usize| solve_block(&chunk.blocks[p], self.pulled(chunk, p, minus(p), 1));
        let step: Vec<_> = (0..chunk.points.len()).map(solve).collect();
        let sums = grouped(chunk, |p| {
            let (g, d, s) = (gradient(&chunk.blocks[p]), damping(&chunk.blocks[p]), step[p]);
            [dot(&g, &solve_block(&chunk.blocks[p], g)), dot(&[d[0] * s[0], d[1] * s[1], d[2] * s[2]], &s)]
        });
        (step, sums)
    }

    /// What a point costs somewhere with the tried centres, and how many observations pull.
    pub(super) fn cost_at(&self, chunk: &Chunk<N>, p: usize, x: Vec3<N>) -> [N; 2] {
        chunk.track(p).fold(zero(), |sum, o| {
            let found = self.linear_at(chunk, x, 1, o);
            [sum[0] + found.cost, sum[1] + N::of(f32::from(u8::from(found.pulls)))]
        })
    }
}

/// Sums over workgroups of 64 points.
pub(super) fn grouped<N: Num, const W: usize>(chunk: &Chunk<N>, value: impl Fn(usize) -> [N; W]) -> Vec<[N; W]> {
    let count = chunk.points.len();
    let lane = |p: usize| if p < count { value(p) } else { zero() };
    (0..count).step_by(64).map(|first| tree((first..first + 64).map(lane).collect())).collect()
}
