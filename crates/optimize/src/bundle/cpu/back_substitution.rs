//! The points' step that follows from the cameras' step, and what the quadratic model promises for both.

use epipole_geometry::camera::Real;

use super::camera_step::CameraStep;
use super::elimination::DampedPoint;
use super::linearization::{Linearization, PointGroups};
use super::point_block::{column_norms_squared, solve_normal};
use super::small::{Vec3, add, from_f64, sub};
use super::structure::Structure;
use crate::parallel;

/// Promises of a step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Promise {
    /// `−½ Σ m·(2r + m)`, `m = J δ`: the decrease of the undamped model, priors left out.
    pub(super) decrease: f64,
    /// Largest point step in units of the column scale.
    pub(super) max_scaled_step: f64,
}

/// Moves every free point: `next = points − (R̃ᵀR̃)⁻¹ J_pᵀ(r + J_c x)`.
pub(super) fn back_substitute<T: Real, const ROWS: usize>(
    structure: &Structure,
    linearization: &Linearization<T, ROWS>,
    damped: &[DampedPoint],
    step: &CameraStep<T>,
    points: &[Vec3<T>],
    next: &mut [Vec3<T>],
) -> Promise {
    let groups = PointGroups::new(structure);
    let pieces = parallel::split_mut(next, &groups.points);
    let mut pieces: Vec<_> = pieces.into_iter().map(|next| (next, Promise::default())).collect();
    parallel::for_each_mut(&mut pieces, |g, (next, promise)| {
        let mut moved: Vec<[T; ROWS]> = Vec::new();
        for (next, p) in next.iter_mut().zip(groups.points[g]..) {
            let mut gradient = [0.0; 3];
            moved.clear();
            for o in structure.track(p) {
                let i = structure.image[o] as usize;
                let v = linearization.camera_product(o, &step.pose[i], step.params(structure.camera[i] as usize));
                let row = &linearization.rows[o];
                let e = std::array::from_fn(|k| v[k].to_f64() + row.residual[k].to_f64());
                gradient = add(&gradient, &row.point_transposed(e));
                moved.push(v);
            }
            let y = solve_normal(&damped[p].triangle, &gradient);
            *next = sub(&points[p], &from_f64(y));
            let scale = column_norms_squared(&linearization.points[p].triangle);
            for k in 0..3 {
                promise.max_scaled_step = promise.max_scaled_step.max(scale[k].sqrt() * y[k].abs());
            }
            for (v, o) in moved.iter().zip(structure.track(p)) {
                let row = &linearization.rows[o];
                let by_point = row.point_product(&y);
                for k in 0..ROWS {
                    let m = v[k].to_f64() - by_point[k];
                    promise.decrease -= m * (row.residual[k].to_f64() + 0.5 * m);
                }
            }
        }
    });
    pieces.iter().fold(Promise::default(), |sum, (_, part)| Promise {
        decrease: sum.decrease + part.decrease,
        max_scaled_step: sum.max_scaled_step.max(part.max_scaled_step),
    })
}
