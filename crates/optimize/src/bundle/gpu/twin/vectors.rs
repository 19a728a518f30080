//! Twins of the vector kernels of PCG.

use epipole_geometry::camera::MAX_PARAMS;

use super::num::{Num, add, dot, tree, zero};
use super::state::State;
use crate::bundle::gpu::layout::FEW_IMAGES;

const LANES: usize = 256;

/// What `pcg_step` leaves behind.
pub(super) struct PcgState<N> {
    /// x, residual, z, direction by unit.
    pub(super) units: Vec<[[N; MAX_PARAMS]; 4]>,
    /// Iterations, rᵀz, twice the model's decrease, ‖x‖².
    pub(super) scalars: [N; 4],
}

impl<N: Num> State<N> {
    fn units(&self) -> usize {
        self.images + self.cameras
    }

    /// Sums over units: lanes take every 256th, then the tree.
    fn by_unit<const W: usize>(&self, value: impl Fn(usize) -> [N; W]) -> [N; W] {
        let lane = |lane: usize| (lane..self.units()).step_by(LANES).map(&value).fold(zero(), add);
        tree((0..LANES).map(lane).collect())
    }

    /// `M⁻¹ r` by units.
    fn precondition(&self, r: &[[N; MAX_PARAMS]]) -> Vec<[N; MAX_PARAMS]> {
        let alone = (0..self.units()).map(|unit| self.precondition_alone(unit, r));
        if !self.has_coarse_space {
            return alone.collect();
        }
        let coarse = self.coarse_correction(r);
        alone.zip(coarse).map(|(a, b)| add(a, b)).collect()
    }

    /// The unit's part of `D⁻¹ r`.
    fn precondition_alone(&self, unit: usize, r: &[[N; MAX_PARAMS]]) -> [N; MAX_PARAMS] {
        let side = self.sizes.side();
        let row = |block: usize, k: usize, pose: &[N; MAX_PARAMS], camera: &[N; MAX_PARAMS]| {
            if k >= side {
                return N::of(0.0);
            }
            let line = &self.inverses[block][k * side..(k + 1) * side];
            dot(&line[..6], &pose[..6]) + dot(&line[6..], &camera[..side - 6])
        };
        if unit < self.images {
            let camera = &r[self.images + self.views[unit].camera];
            return std::array::from_fn(|k| if k < 6 { row(unit, k, &r[unit], camera) } else { N::of(0.0) });
        }
        let (block, pose) = match *self.members(unit - self.images) {
            [image] => (image as usize, r[image as usize]),
            _ => (unit, zero()),
        };
        std::array::from_fn(|k| row(block, 6 + k, &pose, &r[unit]))
    }

    /// The direction times damping and priors.
    fn damped(&self, unit: usize) -> [N; MAX_PARAMS] {
        let (p, prior) = (self.unit(5, unit), self.unit(8, unit));
        std::array::from_fn(|k| (self.lambda + prior[k]) * p[k])
    }

    /// By unit: `Jᵀ v⊥` in column scale plus damping; and the sum of squares that is the curvature.
    fn product(&self) -> (Vec<[N; MAX_PARAMS]>, N) {
        let of_image =
            |image: usize| self.segments_of(image).map(|s| self.partials[s]).fold(zero::<N, { 8 + MAX_PARAMS }>(), add);
        let part = |image: &u32| -> [N; MAX_PARAMS] {
            let sum = of_image(*image as usize);
            std::array::from_fn(|k| sum[8 + k])
        };
        let sum_of = |unit: usize| -> [N; MAX_PARAMS] {
            if unit < self.images {
                let sum = of_image(unit);
                return std::array::from_fn(|k| if k < 6 { sum[k] } else { N::of(0.0) });
            }
            let members = self.members(unit - self.images);
            if members.len() <= FEW_IMAGES {
                return members.iter().map(part).fold(zero(), add);
            }
            let lane = |lane: usize| members.iter().skip(lane).step_by(LANES).map(part).fold(zero(), add);
            tree((0..LANES).map(lane).collect())
        };
        let finish = |unit: usize| -> [N; MAX_PARAMS] {
            let (s, damped, sum) = (self.unit(0, unit), self.damped(unit), sum_of(unit));
            std::array::from_fn(|k| s[k] * sum[k] + damped[k])
        };
        let groups = |lane: usize| self.product_sums.iter().skip(lane).step_by(LANES).map(|s| [s[0]]).fold(zero(), add);
        let points: [N; 1] = tree((0..LANES).map(groups).collect());
        let rest = self.by_unit(|unit| {
            let p = self.unit(5, unit);
            [if unit < self.images { of_image(unit)[6] } else { N::of(0.0) }, dot(&p, &self.damped(unit))]
        });
        ((0..self.units()).map(finish).collect(), points[0] + rest[0] + rest[1])
    }

    /// Direction and rᵀz at the start.
    pub(super) fn pcg_start(&self) -> (Vec<[N; MAX_PARAMS]>, N) {
        let r: Vec<[N; MAX_PARAMS]> = (0..self.units()).map(|unit| self.unit(1, unit)).collect();
        let z = self.precondition(&r);
        let [rz] = self.by_unit(|unit| [dot(&r[unit], &z[unit])]);
        (z, rz)
    }

    pub(super) fn pcg_step(&self) -> PcgState<N> {
        let (q, curvature) = self.product();
        let alpha = self.vectors[0][2] / curvature;
        let step = |section: usize, with: &dyn Fn(usize) -> [N; MAX_PARAMS]| -> Vec<[N; MAX_PARAMS]> {
            let one = |unit| {
                let (a, b) = (self.unit(section, unit), with(unit));
                std::array::from_fn(|k| a[k] + b[k])
            };
            (0..self.units()).map(one).collect()
        };
        let x = step(2, &|unit| self.unit(5, unit).map(|p| alpha * p));
        let r = step(3, &|unit| q[unit].map(|q| -(alpha * q)));
        let z = self.precondition(&r);
        let [improved, rz, length] = self.by_unit(|unit| {
            let b = add(self.unit(1, unit), r[unit]);
            [dot(&x[unit], &b), dot(&r[unit], &z[unit]), dot(&x[unit], &x[unit])]
        });
        let beta = rz / self.vectors[0][2];
        let one = |unit: usize| {
            let direction = add(z[unit], self.unit(5, unit).map(|p| beta * p));
            [x[unit], r[unit], z[unit], direction]
        };
        let scalars = [self.vectors[0][0] + N::of(1.0), rz, improved, length];
        PcgState { units: (0..self.units()).map(one).collect(), scalars }
    }
}
