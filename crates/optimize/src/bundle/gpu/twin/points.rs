//! Twins of the kernels that walk tracks, one point an invocation; those that decide what counts are in `sight.rs`.

use epipole_geometry::camera::MAX_PARAMS;

use super::num::{Num, Vec3, add, dot, sub, tree, zero};
use super::observation::{Errors, Row, loss_weight, weighted};
use super::state::{Block, State};
use crate::bundle::gpu::records::OUT;

/// `(R̃ᵀR̃)⁻¹ g` with the damped triangle of a block.
pub(super) fn solve_normal<N: Num>(block: &Block<N>, g: Vec3<N>) -> Vec3<N> {
    let (top, bottom) = (block[4], block[5]);
    let y = solve_row(block, g);
    let c = y[2] * bottom[2];
    let b = (y[1] - bottom[1] * c) * bottom[0];
    [(y[0] - top[1] * b - top[2] * c) * top[0], b, c]
}

/// `v R̃⁻¹`.
pub(super) fn solve_row<N: Num>(block: &Block<N>, v: Vec3<N>) -> Vec3<N> {
    let (top, bottom) = (block[4], block[5]);
    let a = v[0] * top[0];
    let b = (v[1] - a * top[1]) * bottom[0];
    [a, b, (v[2] - a * top[2] - b * bottom[1]) * bottom[2]]
}

impl<N: Num> State<N> {
    pub(super) fn num_points(&self) -> usize {
        self.points.len()
    }

    /// The rows of a point's observations that count.
    fn rows_of(&self, p: usize) -> impl Iterator<Item = (usize, usize, Row<N>)> + '_ {
        self.track(p).filter(|&o| self.by_point[o].1[0].value() != 0.0).map(move |o| {
            let image = self.image(o);
            (o, image, self.row(p, image, self.by_point[o].1))
        })
    }

    /// Sums over workgroups of 64 points.
    pub(super) fn grouped<const W: usize>(&self, value: impl Fn(usize) -> [N; W]) -> Vec<[N; W]> {
        let row = |points: &std::ops::Range<usize>| {
            let lane = |k: usize| points.clone().nth(k).map_or(zero(), &value);
            tree((0..64).map(lane).collect())
        };
        self.rows.iter().map(row).collect()
    }

    /// By observation: roots of the weights.
    pub(super) fn reweight(&self) -> Vec<[N; 2]> {
        let weight = |(o, [e, _]): (usize, &[Errors<N>; 2])| {
            if self.by_point[o].0 & OUT != 0 {
                return zero();
            }
            let sigmas = self.measured[o].weight * e[2];
            let pixel = loss_weight(self.loss, dot(&e[..2], &e[..2])).root();
            [pixel, self.measured[o].weight * loss_weight(self.depth_loss, sigmas * sigmas).root()]
        };
        self.residuals.iter().enumerate().map(weight).collect()
    }

    /// By point: `J_pᵀ J_p` (00 01 02 11 12 22) and `J_pᵀ r`.
    pub(super) fn normal_equations(&self) -> Vec<([N; 6], Vec3<N>)> {
        let one = |p| {
            let (mut normal, mut gradient) = (zero(), zero());
            for (o, _, row) in self.rows_of(p) {
                gradient = add(gradient, row.point_transposed(weighted(self.by_point[o].1, self.residuals[o][0])));
                for j in row.point {
                    let products = [j[0] * j[0], j[0] * j[1], j[0] * j[2], j[1] * j[1], j[1] * j[2], j[2] * j[2]];
                    normal = add(normal, products);
                }
            }
            (normal, gradient)
        };
        (0..self.num_points()).map(one).collect()
    }

    /// By point: `J_pᵀ J_c x` for camera steps by unit, and its solution with the damped block.
    fn moved(&self, p: usize, start: Vec3<N>, step: impl Fn(usize) -> [N; MAX_PARAMS]) -> Vec3<N> {
        let mut gradient = start;
        if self.blocks[p][3][3].value() == 1.0 {
            for (_, image, row) in self.rows_of(p) {
                let (pose, camera) = (step(image), step(self.images + self.views[image].camera));
                let x = std::array::from_fn(|k| if k < 8 { pose[k] } else { camera[k - 8] });
                gradient = add(gradient, row.point_transposed(row.camera_product(&x)));
            }
        }
        solve_normal(&self.blocks[p], gradient)
    }

    /// By point: y; by workgroup: λ‖y‖² in column scale.
    pub(super) fn product_point(&self) -> (Vec<Vec3<N>>, Vec<[N; 1]>) {
        let y: Vec<_> = (0..self.num_points()).map(|p| self.moved(p, zero(), |unit| self.unit(7, unit))).collect();
        let squares = |p: usize| {
            let n = self.blocks[p][3];
            [self.lambda * dot(&[n[0] * y[p][0], n[1] * y[p][1], n[2] * y[p][2]], &y[p])]
        };
        let sums = self.grouped(squares);
        (y, sums)
    }

    /// By point: tried position; by workgroup: ‖y‖² in column scale and `gᵀy₀`.
    pub(super) fn back_substitute(&self) -> (Vec<Vec3<N>>, Vec<[N; 2]>) {
        let gradient = |p: usize| [self.blocks[p][2][0], self.blocks[p][2][1], self.blocks[p][2][2]];
        let scaled = |unit| {
            let (s, x) = (self.unit(0, unit), self.unit(2, unit));
            std::array::from_fn(|k| s[k] * x[k])
        };
        let y: Vec<_> = (0..self.num_points()).map(|p| self.moved(p, gradient(p), scaled)).collect();
        let sums = self.grouped(|p| {
            let n = self.blocks[p][3];
            let alone = solve_normal(&self.blocks[p], gradient(p));
            let scaled = [n[0] * y[p][0], n[1] * y[p][1], n[2] * y[p][2]];
            [dot(&scaled, &y[p]), dot(&gradient(p), &alone)]
        });
        (self.points.iter().zip(&y).map(|(point, &y)| sub(point.offset, y)).collect(), sums)
    }
}
