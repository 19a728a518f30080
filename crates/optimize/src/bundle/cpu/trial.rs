//! Residuals: from scratch in `f64`, and after a step as exact differences where the scalar needs them.

use epipole_geometry::camera::{CameraModel, Real};

use super::PIXELS;
use super::depth_limits::DepthLimits;
use super::linearization::PointGroups;
use super::projection::Side;
use super::rows::{Losses, depth_difference, depth_residual};
use super::small::{Vec3, add, from_f64, rotate, sub};
use super::state::{Cameras, Lattice, Points, ViewChange};
use super::structure::Structure;
use crate::active::ActiveSet;
use crate::parallel;

/// A residual that marks an observation without a valid projection.
fn invalid<T: Real, const ROWS: usize>() -> [T; ROWS] {
    [T::from_f64(f64::NAN); ROWS]
}

/// Whether a depth is more than the least; NaN is not.
#[inline(always)]
fn is_beyond<T: Real>(depth: T, least: T) -> bool {
    depth > least
}

/// Residual of one observation, invalid at or below the least depth.
#[inline(always)]
pub(super) fn residual<T: Real, const ROWS: usize>(
    side: Side,
    model: CameraModel,
    params: &[T],
    q: Vec3<T>,
    min_depth: Option<T>,
    px: [f64; 2],
    depth: [f64; 2],
) -> [T; ROWS] {
    if min_depth.is_some_and(|least| !is_beyond(q[2], least)) {
        return invalid();
    }
    match side.project(model, params, q) {
        Some(pixel) => {
            let mut x = pixel[0] - T::from_f64(px[0]);
            if model == CameraModel::Equirectangular {
                // Across the seam the short way round.
                let width = params[0].to_f64();
                x -= T::from_f64(width * (x.to_f64() / width).round());
            }
            let mut r = [T::ZERO; ROWS];
            (r[0], r[1]) = (x, pixel[1] - T::from_f64(px[1]));
            if ROWS > PIXELS {
                r[PIXELS] = depth_residual(q[2], depth);
                if !r[PIXELS].is_finite() {
                    return invalid();
                }
            }
            r
        }
        None => invalid(),
    }
}

/// All residuals at a state, evaluated in `f64` whatever the working scalar: its rounding is then a fixed, tiny change of
/// the observations and not noise.
pub(super) fn evaluate<T: Real, const ROWS: usize>(
    structure: &Structure,
    lattice: &Lattice,
    cameras: &Cameras<T>,
    points: &Points<T>,
    depths: &DepthLimits,
    out: &mut [[T; ROWS]],
) {
    let wide = cameras.widened();
    let groups = PointGroups::new(structure);
    let mut pieces = parallel::split_mut(out, &groups.observations(1));
    parallel::for_each_mut(&mut pieces, |g, out| {
        let first = structure.track(groups.points[g]).start;
        for p in groups.points[g]..groups.points[g + 1] {
            let offset = super::small::to_f64(points.offset[p]);
            for o in structure.track(p) {
                let i = structure.image[o] as usize;
                let c = structure.camera[i] as usize;
                let view = &wide.0[i];
                let q = rotate(
                    &view.rotation,
                    &lattice.difference(&offset, points.cell(p), &view.center, &view.center_cell),
                );
                let depth = if ROWS > PIXELS { structure.depth(o) } else { [0.0; 2] };
                let (params, least) = (&wide.1[c], depths.least(i));
                let r =
                    residual::<f64, ROWS>(depths.side, structure.model[c], params, q, least, structure.px[o], depth);
                out[o - first] = from_f64(r);
            }
        }
    });
}

/// The state before and after a step.
pub(super) struct Move<'a, T> {
    pub(super) cameras: &'a Cameras<T>,
    pub(super) next_cameras: &'a Cameras<T>,
    pub(super) points: &'a Points<T>,
    pub(super) next_points: &'a [Vec3<T>],
}

/// Residuals after a step, and the decrease of the cost on the active observations; NaN to refuse the step.
pub(super) fn try_move<T: Real, const ROWS: usize>(
    structure: &Structure,
    lattice: &Lattice,
    state: &Move<'_, T>,
    active: &ActiveSet,
    losses: Losses,
    depths: &DepthLimits,
    before: &[[T; ROWS]],
    after: &mut [[T; ROWS]],
) -> f64 {
    let changes = state.cameras.change_to(state.next_cameras, lattice);
    let param_changes = state.cameras.param_changes(state.next_cameras);
    // Without a lattice the scalar is f64, which does not need differences.
    let incremental = lattice.cell != 0.0;
    let groups = PointGroups::new(structure);
    let pieces = parallel::split_mut(after, &groups.observations(1));
    let mut pieces: Vec<_> = pieces.into_iter().map(|after| (after, 0.0f64, 0usize)).collect();
    parallel::for_each_mut(&mut pieces, |g, (after, change, flipped)| {
        let first = structure.track(groups.points[g]).start;
        for p in groups.points[g]..groups.points[g + 1] {
            let moved = sub(&state.next_points[p], &state.points.offset[p]);
            for o in structure.track(p) {
                let is_active = active.is_active(o);
                if !is_active && !active.may_return() {
                    continue;
                }
                let i = structure.image[o] as usize;
                let c = structure.camera[i] as usize;
                let next = &state.next_cameras.views[i];
                let params = &state.next_cameras.view_params[c];
                let least = depths.least(i).map(T::from_f64);
                let r = before[o];
                let depth = if ROWS > PIXELS { structure.depth(o) } else { [0.0; 2] };
                let (r_after, delta) = if incremental && r[0].is_finite() {
                    let view = &state.cameras.views[i];
                    let ray = lattice.difference(
                        &state.points.offset[p],
                        state.points.cell(p),
                        &view.center,
                        &view.center_cell,
                    );
                    let q = rotate(&view.rotation, &ray);
                    let (q_change, depth_after) = ray_change(&q, &ray, &moved, &changes[i], next);
                    let change = if least.is_some_and(|least| !is_beyond(depth_after, least)) {
                        None
                    } else {
                        let params = &state.cameras.view_params[c];
                        depths.side.difference(structure.model[c], params, &param_changes[c], q, q_change)
                    };
                    match change {
                        Some(change) => {
                            let mut delta = [T::ZERO; ROWS];
                            delta[..PIXELS].copy_from_slice(&change);
                            if ROWS > PIXELS {
                                delta[PIXELS] = depth_difference(q[2], q_change[2], depth[1]);
                            }
                            (std::array::from_fn(|k| r[k] + delta[k]), delta)
                        }
                        None => (invalid(), [T::ZERO; ROWS]),
                    }
                } else {
                    let ray = lattice.difference(
                        &state.next_points[p],
                        state.points.cell(p),
                        &next.center,
                        &next.center_cell,
                    );
                    let q = rotate(&next.rotation, &ray);
                    let (model, px) = (structure.model[c], structure.px[o]);
                    let r_after = residual::<T, ROWS>(depths.side, model, params, q, least, px, depth);
                    (r_after, std::array::from_fn(|k| r_after[k] - r[k]))
                };
                after[o - first] = r_after;
                if is_active {
                    if r_after.iter().all(|v| v.is_finite()) {
                        *change += losses.difference(&r, &delta);
                    } else {
                        *flipped += 1;
                        *change += active.flip_charge(losses.value(structure, o, &r));
                    }
                }
            }
        }
    });
    let flipped = pieces.iter().map(|(_, _, flipped)| flipped).sum();
    if active.refuses(flipped) {
        return f64::NAN;
    }
    -0.5 * pieces.iter().map(|(_, change, _)| change).sum::<f64>()
}

/// Change of the point in the camera frame, `δR t + R' δt`, and its depth after the step.
#[inline(always)]
fn ray_change<T: Real>(
    q: &Vec3<T>,
    ray: &Vec3<T>,
    moved: &Vec3<T>,
    change: &ViewChange<T>,
    next: &super::state::View<T>,
) -> (Vec3<T>, T) {
    let ray_moved = sub(moved, &change.center);
    let q_change = add(&rotate(&change.rotation, ray), &rotate(&next.rotation, &ray_moved));
    (q_change, q[2] + q_change[2])
}
