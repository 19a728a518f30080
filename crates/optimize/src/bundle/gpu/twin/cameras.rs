//! Twins of the kernels that walk segments of an image, and of what gathers their sums.

use std::ops::Range;

use epipole_geometry::camera::MAX_PARAMS;

use super::num::{Num, add, cross, dot, sub, tree, zero};
use super::observation::{Weights, weighted};
use super::points::{solve_normal, solve_row};
use super::state::{State, Step};
use crate::bundle::gpu::records::{HIDDEN, OUT};

impl<N: Num> State<N> {
    /// Sums over segments: lanes take every 64th observation, then the tree.
    fn by_segment(&self, value: impl Fn(usize, usize, Weights<N>) -> Step<N>) -> Vec<Step<N>> {
        let segment = |&[image, start, end, _]: &[u32; 4]| {
            let lane = |lane: usize| {
                let mut sum = zero();
                for o in (start as usize + lane..end as usize).step_by(64) {
                    let (point, weights, _) = self.by_image[o];
                    if weights[0].value() != 0.0 {
                        sum = add(sum, value(image as usize, point, weights));
                    }
                }
                sum
            };
            tree((0..64).map(lane).collect())
        };
        self.segments.iter().map(segment).collect()
    }

    /// By segment: squared norms of the camera columns, with the count in place 6.
    pub(super) fn linearize_camera(&self) -> Vec<Step<N>> {
        self.by_segment(|image, point, weights| {
            let row = self.row(point, image, weights);
            let [x, y, z] = row.point;
            let [rx, ry, rz] = row.point.map(|row_by_point| cross(row.ray, row_by_point));
            let params: [N; MAX_PARAMS] =
                std::array::from_fn(|k| row.params[0][k] * row.params[0][k] + row.params[1][k] * row.params[1][k]);
            std::array::from_fn(|k| match k {
                0..3 => rx[k] * rx[k] + ry[k] * ry[k] + rz[k] * rz[k],
                3..6 => x[k - 3] * x[k - 3] + y[k - 3] * y[k - 3] + z[k - 3] * z[k - 3],
                6 => N::of(1.0),
                7 => N::of(0.0),
                _ => params[k - 8],
            })
        })
    }

    /// By segment: `J_cᵀ v⊥` with `‖v⊥‖²` in place 6.
    pub(super) fn product_camera(&self) -> Vec<Step<N>> {
        self.by_segment(|image, point, weights| {
            let row = self.row(point, image, weights);
            let (pose, camera) = (self.unit(7, image), self.unit(7, self.images + self.views[image].camera));
            let x = std::array::from_fn(|k| if k < 8 { pose[k] } else { camera[k - 8] });
            let v = sub(row.camera_product(&x), row.point_product(self.points[point].s));
            row.camera_transposed(v)
        })
    }

    /// By segment: upper triangle of the Schur–Jacobi block (plain where its camera's block is exact), the right-hand side,
    /// the pose's plain block.
    pub(super) fn precondition_camera(&self) -> Vec<Vec<N>> {
        let (side, triangle) = (self.sizes.side(), self.sizes.triangle());
        let segment = |&[image, start, end, _]: &[u32; 4]| {
            let mut total = vec![N::of(0.0); self.sizes.block_sums()];
            for batch in (start as usize..end as usize).step_by(64) {
                let mut sum = vec![N::of(0.0); total.len()];
                for o in batch..(batch + 64).min(end as usize) {
                    let (point, weights, index) = self.by_image[o];
                    if weights[0].value() == 0.0 {
                        continue;
                    }
                    let row = self.row(point, image as usize, weights);
                    let z = row.point.map(|j| solve_row(&self.blocks[point], j));
                    let m: [[N; 3]; 3] = std::array::from_fn(|a| {
                        std::array::from_fn(|b| {
                            let product = dot(&z[a], &z[b]);
                            if a == b { N::of(1.0) - product } else { -product }
                        })
                    });
                    let columns = |e| {
                        let all = row.camera_transposed(e);
                        (0..side).map(|k| if k < 6 { all[k] } else { all[k + 2] }).collect::<Vec<_>>()
                    };
                    let unit = |k: usize| std::array::from_fn(|i| N::of(if i == k { 1.0 } else { 0.0 }));
                    let j = [columns(unit(0)), columns(unit(1)), columns(unit(2))];
                    let moved = row.point_product(self.points[point].s);
                    let e = sub(weighted(weights, self.residuals[index][0]), moved);
                    let exact = self.exact[self.views[image as usize].camera];
                    let mut k = 0;
                    let mut poses = triangle + side;
                    for a in 0..side {
                        for b in a..side {
                            let at = |k: usize| [j[0][k], j[1][k], j[2][k]];
                            let plain = dot(&at(a), &at(b));
                            let projected = dot(&at(a), &m.map(|m| dot(&m, &at(b))));
                            sum[k] += if exact && b >= 6 { plain } else { projected };
                            if b < 6 {
                                sum[poses] += plain;
                                poses += 1;
                            }
                            k += 1;
                        }
                    }
                    for a in 0..side {
                        sum[k + a] -= dot(&[j[0][a], j[1][a], j[2][a]], &e);
                    }
                }
                total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
            }
            total
        };
        self.segments.iter().map(segment).collect()
    }

    /// By span of points and exact camera: what the points take from its block.
    pub(super) fn precondition_group(&self, chunks: &[Range<usize>], cameras: &[u32]) -> Vec<Vec<N>> {
        let width = self.sizes.params;
        let factor = |p: usize, camera: u32| -> [[N; MAX_PARAMS]; 3] {
            let mut sum = [zero::<N, MAX_PARAMS>(); 3];
            for o in self.tracks[p] as usize..self.tracks[p + 1] as usize {
                let (image, weights) = ((self.by_point[o].0 & !(OUT | HIDDEN)) as usize, self.by_point[o].1);
                if self.blocks[p][3][3].value() != 1.0
                    || weights[0].value() == 0.0
                    || self.views[image].camera != camera as usize
                {
                    continue;
                }
                let row = self.row(p, image, weights);
                for (c, sum) in sum.iter_mut().enumerate() {
                    *sum = std::array::from_fn(|k| {
                        sum[k] + (row.point[0][c] * row.params[0][k] + row.point[1][c] * row.params[1][k])
                    });
                }
            }
            let solved: [_; MAX_PARAMS] = std::array::from_fn(|k| solve_row(&self.blocks[p], sum.map(|row| row[k])));
            std::array::from_fn(|c| solved.map(|column| column[c]))
        };
        let mut out = Vec::new();
        for chunk in chunks {
            let groups = chunk.len().div_ceil(64);
            let spans = groups.clamp(1, 256);
            let length = 64 * groups.div_ceil(spans);
            for first in (0..spans).map(|s| chunk.start + s * length) {
                for &camera in cameras {
                    let mut total = vec![N::of(0.0); width * width];
                    for batch in (first..chunk.end.min(first + length)).step_by(64) {
                        let mut sum = vec![N::of(0.0); width * width];
                        for p in batch..(batch + 64).min(chunk.end) {
                            for row in factor(p, camera) {
                                let entry = |k: usize| row[k / width] * row[k % width];
                                sum.iter_mut().enumerate().for_each(|(k, sum)| *sum += entry(k));
                            }
                        }
                        total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
                    }
                    out.push(total);
                }
            }
        }
        out
    }

    /// By unit: squared norms of the columns that are kept with the priors on them, as `scale_camera` sums them; zero where
    /// nothing may move.
    pub(super) fn column_norms(&self) -> Vec<[N; MAX_PARAMS]> {
        let of_image = |image: usize| self.segments_of(image).map(|s| self.partials[s]).fold(zero(), add);
        let unit = |unit: usize| {
            let (norms, count): ([N; MAX_PARAMS], N) = if unit < self.images {
                let sum: Step<N> = of_image(unit);
                (std::array::from_fn(|k| if k < 6 { sum[k] } else { N::of(0.0) }), sum[6])
            } else {
                let images = self.members(unit - self.images).iter();
                let sum: Step<N> = images.map(|&i| of_image(i as usize)).fold(zero(), add);
                (std::array::from_fn(|k| sum[8 + k]), sum[6])
            };
            let prior = self.prior(unit).0;
            let enough = |k: usize| count.value() >= 6.0 || prior[k].value() > 0.0;
            let keep = |k: usize| enough(k) && self.freedom[unit][k].value() == 1.0;
            std::array::from_fn(|k| if keep(k) { norms[k] + prior[k] } else { N::of(0.0) })
        };
        (0..self.images + self.cameras).map(unit).collect()
    }

    /// Diagonal and gradient of the priors on a unit.
    fn prior(&self, unit: usize) -> ([N; MAX_PARAMS], [N; MAX_PARAMS]) {
        let Some(camera) = unit.checked_sub(self.images) else { return (zero(), zero()) };
        let (prior, params) = (&self.priors[camera], &self.intrinsics[camera]);
        let diagonal: [N; MAX_PARAMS] = std::array::from_fn(|k| prior[MAX_PARAMS + k]);
        (diagonal, std::array::from_fn(|k| diagonal[k] * (params[k] - prior[k])))
    }

    /// By unit: diagonal and gradient of the priors in the column scale that is there.
    pub(super) fn scaled_priors(&self) -> Vec<[N; 2 * MAX_PARAMS]> {
        let unit = |unit: usize| {
            let (scale, (diagonal, gradient)) = (self.unit(0, unit), self.prior(unit));
            std::array::from_fn(|k| {
                if k < MAX_PARAMS {
                    scale[k] * scale[k] * diagonal[k]
                } else {
                    scale[k - MAX_PARAMS] * gradient[k - MAX_PARAMS]
                }
            })
        };
        (0..self.images + self.cameras).map(unit).collect()
    }

    /// What the priors cost less at the tried parameters, and what they cost there.
    pub(super) fn prior_camera(&self) -> [N; 2] {
        let camera = |camera: usize| {
            let at = |block: usize| &self.intrinsics[camera + block * self.cameras];
            let (before, after, change, prior) = (at(0), at(1), at(2), &self.priors[camera]);
            let (half, two) = (N::of(0.5), N::of(2.0));
            let off: [N; MAX_PARAMS] = std::array::from_fn(|k| after[k] - prior[k]);
            let from: [N; MAX_PARAMS] = std::array::from_fn(|k| two * (before[k] - prior[k]) + change[k]);
            let weighted =
                |v: &[N; MAX_PARAMS]| -> [N; MAX_PARAMS] { std::array::from_fn(|k| prior[MAX_PARAMS + k] * v[k]) };
            [-(half * dot(&weighted(change), &from)), half * dot(&weighted(&off), &off)]
        };
        let lane = |lane: usize| (lane..self.cameras).step_by(256).map(camera).fold(zero(), add);
        tree((0..256).map(lane).collect())
    }

    /// By point: the step it would take alone, with its damped block.
    pub(super) fn newton(&self) -> Vec<[N; 3]> {
        self.blocks.iter().map(|b| solve_normal(b, [b[2][0], b[2][1], b[2][2]])).collect()
    }
}
