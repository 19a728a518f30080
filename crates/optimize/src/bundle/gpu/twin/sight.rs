//! Twins of `sight.wgsl` and `cost.wgsl`, and of the kernels that decide what counts: `refresh` and `trial`.

use super::num::{Num, Vec3, add, dot, sub, zero};
use super::observation::{Errors, rotate};
use super::state::{Point, State};
use crate::active::{LEAST_SQUARE, RETURN_SHARE};
use crate::bundle::gpu::records::{ALL, FIRST_PASS, FROM_SCRATCH, HIDDEN, MAX_DEPTH_SIGMAS, OUT, TRUNCATED};

/// What is found for an observation that falls behind its camera, as `INVALID` in `types.wgsl`.
pub(super) const INVALID: f32 = 1e30;

/// What `refresh` finds of an observation.
#[derive(Clone, Copy)]
pub(super) struct Refreshed<N> {
    pub(super) errors: Errors<N>,
    pub(super) counts: bool,
    /// How near the decision was, in units of what rounding could do to it; infinite where there was none to make.
    pub(super) margin: f64,
}

impl<N: Num> State<N> {
    pub(super) fn is_valid(&self, o: usize, e: Errors<N>) -> bool {
        (self.measured[o].weight * e[2]).value().abs() <= f64::from(MAX_DEPTH_SIGMAS)
    }

    fn is_deep_enough(&self, image: usize, z: N) -> bool {
        self.activation != TRUNCATED || z > self.limits[image][0]
    }

    /// Errors of an observation with its point anywhere; `None` where there is no valid projection.
    pub(super) fn errors(&self, o: usize, point: &Point<N>) -> Option<Errors<N>> {
        let view = &self.views[self.image(o)];
        self.errors_at(o, rotate(view, self.ray(point, view)))
    }

    /// The same with its point anywhere in the camera's frame.
    pub(super) fn errors_at(&self, o: usize, q: Vec3<N>) -> Option<Errors<N>> {
        let image = self.image(o);
        let view = &self.views[image];
        let [x, y] = self.project_residual(view.camera, q, self.pixels[o])?;
        let measured = self.measured[o];
        let has_depth = measured.weight.value() > 0.0;
        let e = [x, y, if has_depth { N::of(1.0) / q[2] - measured.inverse } else { N::of(0.0) }];
        (self.is_deep_enough(image, q[2]) && self.is_valid(o, e)).then_some(e)
    }

    /// The cost of an observation counted from the bound of its depth.
    pub(super) fn worth(&self, o: usize, e: Errors<N>) -> N {
        self.cost(self.measured[o], e) - self.depth_bound(self.measured[o])
    }

    /// Whether the projection lies inside the frustum, and how far from its border, px.
    pub(super) fn is_inside(&self, o: usize, e: Errors<N>) -> (bool, f64) {
        let limits = &self.limits[self.image(o)];
        let px = [self.pixels[o][0] + e[0], self.pixels[o][1] + e[1]];
        let sides = [px[0] - limits[1], px[1] - limits[2], limits[3] - px[0], limits[4] - px[1]].map(N::value);
        (sides.iter().all(|&s| s >= 0.0), sides.iter().fold(f64::INFINITY, |least, s| least.min(s.abs())))
    }

    /// By observation.
    pub(super) fn refresh(&self) -> Vec<Refreshed<N>> {
        let invalid = [INVALID, INVALID, 0.0].map(N::of);
        let mut out = Vec::with_capacity(self.by_point.len());
        for (p, point) in self.points.iter().enumerate() {
            for o in self.track(p) {
                let word = self.by_point[o].0;
                let (was_active, hidden) = (word & OUT == 0, word & HIDDEN != 0);
                let kept = self.residuals[o][0];
                if self.activation != TRUNCATED {
                    let now =
                        if was_active && (!hidden || self.activation == ALL) { self.errors(o, point) } else { None };
                    let errors = now.unwrap_or(kept);
                    out.push(Refreshed { errors, counts: now.is_some(), margin: f64::INFINITY });
                    continue;
                }
                let first = self.refresh_flags & FIRST_PASS != 0;
                let anew = !was_active || first || self.refresh_flags & FROM_SCRATCH != 0;
                let errors = if anew { self.errors(o, point).unwrap_or(invalid) } else { kept };
                if errors[0].value() == f64::from(INVALID) || hidden {
                    out.push(Refreshed { errors, counts: false, margin: f64::INFINITY });
                    continue;
                }
                let limit = self.tau * N::of(if was_active || first { 1.0 } else { RETURN_SHARE as f32 });
                let worth = self.worth(o, errors);
                let (inside, border) =
                    if was_active && !first { (true, f64::INFINITY) } else { self.is_inside(o, errors) };
                let margin = ((worth - limit).value() / limit.value()).abs().min(border);
                out.push(Refreshed { errors, counts: worth < limit && inside, margin });
            }
        }
        out
    }

    /// By workgroup, of observations as they were found: nothing, cost, nothing, how many count, Σ ln s of those.
    pub(super) fn refresh_sums(&self, found: &[Refreshed<N>]) -> Vec<[N; 5]> {
        self.grouped(|p| {
            self.track(p).fold(zero(), |sum, o| {
                let Refreshed { errors, counts, .. } = found[o];
                let cost = match self.activation == TRUNCATED && !counts {
                    true => self.depth_bound(self.measured[o]),
                    false => self.cost(self.measured[o], errors),
                };
                let [count, logarithm] = if counts { [N::of(1.0), logarithm(errors)] } else { zero() };
                add(sum, [N::of(0.0), cost, N::of(0.0), count, logarithm])
            })
        })
    }

    /// By observation: tried errors; by workgroup: change of the cost, cost after, observations that fall behind their
    /// cameras, that count after, Σ ln s of those.
    pub(super) fn trial(&self) -> (Vec<Errors<N>>, Vec<[N; 5]>) {
        let mut after = Vec::with_capacity(self.residuals.len());
        let mut terms = Vec::with_capacity(self.num_points());
        for p in 0..self.num_points() {
            let mut sum: [N; 5] = zero();
            for o in self.track(p) {
                let (r, measured) = (self.residuals[o][0], self.measured[o]);
                let is_out = self.by_point[o].0 & OUT != 0;
                let change = if is_out { None } else { self.change(p, o) };
                let tried = match (change, is_out) {
                    (Some(change), _) => add(r, change),
                    (None, true) => r,
                    (None, false) => [INVALID, INVALID, 0.0].map(N::of),
                };
                let gone = tried[0].value() == f64::from(INVALID);
                if let Some(change) = change {
                    let more =
                        [self.cost_change(measured, r, change), N::of(0.0), N::of(0.0), N::of(1.0), logarithm(tried)];
                    sum = add(sum, more);
                } else if !is_out {
                    sum[0] += if self.activation == TRUNCATED { self.tau - self.worth(o, r) } else { N::of(0.0) };
                    sum[2] += N::of(1.0);
                }
                if self.activation != TRUNCATED || !(gone || is_out) {
                    sum[1] += self.cost(measured, if gone { r } else { tried });
                }
                after.push(tried);
            }
            terms.push(sum);
        }
        (after, self.grouped(|p| terms[p]))
    }

    /// The change of an observation's errors in the step under way; `None` where it loses its projection.
    fn change(&self, p: usize, o: usize) -> Option<Errors<N>> {
        let image = self.image(o);
        let (view, next) = (&self.views[image], &self.views[image + self.images]);
        let change = &self.views[image + 2 * self.images];
        let ray = self.ray(&self.points[p], view);
        let q = rotate(view, ray);
        let c = self.changes[p];
        let dq = add(rotate(change, ray), rotate(next, sub([c[0], c[1], c[2]], change.center)));
        let [x, y] = self.project_change(view.camera, q, dq)?;
        let has_depth = self.measured[o].weight.value() > 0.0;
        let e = [x, y, if has_depth { -dq[2] / (q[2] * (q[2] + dq[2])) } else { N::of(0.0) }];
        let after = add(self.residuals[o][0], e);
        (self.is_deep_enough(image, q[2] + dq[2]) && self.is_valid(o, after)).then_some(e)
    }
}

fn logarithm<N: Num>(e: Errors<N>) -> N {
    let square = dot(&e[..2], &e[..2]);
    let least = N::of(LEAST_SQUARE as f32);
    (if square > least { square } else { least }).logarithm()
}
