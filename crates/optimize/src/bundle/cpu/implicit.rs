//! The reduced matrix as an operator on observations, never formed.
//!
//! `v = J_c x`, `v⊥ = v − J_p (R̃ᵀR̃)⁻¹ J_pᵀ v`, `S x = J_cᵀ v⊥ + λDx`, and `xᵀSx = ‖v⊥‖² + λ(‖y‖² + ‖x‖²)` is a sum of
//! squares: cancellation happens inside an observation, not in sums over a camera (source: `solver.md` §1.3 a).

use epipole_geometry::camera::Real;

use super::camera_step::CameraStep;
use super::elimination::DampedPoint;
use super::linearization::{Linearization, PointGroups};
use super::normal::{CameraNormal, transposed_product};
use super::point_block::{column_norms_squared, solve_normal};
use super::small::{add, dot, from_f64, to_f64};
use super::structure::Structure;
use crate::parallel;
use crate::reduced::LinearOperator;

/// See the module.
pub(super) struct ImplicitOperator<'a, T, const ROWS: usize> {
    pub(super) structure: &'a Structure,
    pub(super) linearization: &'a Linearization<T, ROWS>,
    pub(super) damped: &'a [DampedPoint],
    pub(super) normal: &'a CameraNormal,
    /// `λ diag(JᵀJ)` plus the priors' own diagonal.
    pub(super) diagonal: Vec<f64>,
    pub(super) lambda: f64,
    /// `v⊥`, one per observation.
    pub(super) projected: Vec<[T; ROWS]>,
}

impl<T: Real, const ROWS: usize> LinearOperator for ImplicitOperator<'_, T, ROWS> {
    fn apply(&mut self, x: &[f64], out: &mut [f64]) -> f64 {
        let step = CameraStep::<T>::new(self.structure, x);
        let groups = PointGroups::new(self.structure);
        let (structure, linearization, damped, lambda) = (self.structure, self.linearization, self.damped, self.lambda);
        let mut pieces: Vec<_> = parallel::split_mut(&mut self.projected, &groups.observations(1))
            .into_iter()
            .map(|projected| (projected, 0.0))
            .collect();
        parallel::for_each_mut(&mut pieces, |g, (projected, squares)| {
            let first = structure.track(groups.points[g]).start;
            for p in groups.points[g]..groups.points[g + 1] {
                let mut gradient = [0.0; 3];
                for o in structure.track(p) {
                    let i = structure.image[o] as usize;
                    let params = step.params(structure.camera[i] as usize);
                    let v = linearization.camera_product(o, &step.pose[i], params);
                    gradient = add(&gradient, &linearization.rows[o].point_transposed(to_f64(v)));
                    projected[o - first] = v;
                }
                let y = solve_normal(&damped[p].triangle, &gradient);
                let scale = column_norms_squared(&linearization.points[p].triangle);
                *squares += lambda * (0..3).map(|k| scale[k] * y[k] * y[k]).sum::<f64>();
                let y = from_f64(y);
                for o in structure.track(p) {
                    let v = &mut projected[o - first];
                    for k in 0..ROWS {
                        v[k] -= dot(&linearization.rows[o].point[k], &y);
                        *squares += (v[k] * v[k]).to_f64();
                    }
                }
            }
        });
        let mut curvature: f64 = pieces.iter().map(|(_, squares)| squares).sum();
        let product = transposed_product(structure, linearization, |o| to_f64(self.projected[o]));
        for k in 0..out.len() {
            out[k] = if self.normal.removed[k] { 0.0 } else { product[k] + self.diagonal[k] * x[k] };
            curvature += self.diagonal[k] * x[k] * x[k];
        }
        curvature
    }
}
