//! Twin of `revive.wgsl`.

use std::f32::consts::{PI, TAU};

use epipole_geometry::camera::CameraFamily;

use super::num::{Num, Vec3, add, cross, dot, scale, sub, zero};
use super::observation::{Errors, loss_value, loss_weight, rotate};
use super::points::solve_normal;
use super::state::{State, View};
use crate::active::RETURN_SHARE;
use crate::bundle::gpu::records::{HIDDEN, OUT};

const STEPS: usize = 8;
const LAMBDA: f32 = 1e-6;
const LEAST_GAIN: f32 = 0.1;
const RANK_RATIO: f64 = 1e6;

/// What comes of a point that is looked at.
#[derive(Clone, Copy)]
pub(super) struct Revived<N> {
    /// Image that the position is given from.
    pub(super) origin: usize,
    /// Best position in the world frame from that image's centre.
    pub(super) from_center: Vec3<N>,
    /// What it has to cost less than, and what it costs.
    pub(super) before: N,
    pub(super) best: N,
}

/// Folds a row into a triangle (00 01 02 11 12 22), as `triangle.wgsl`.
fn fold_row<N: Num>(r: &mut [N; 6], mut v: Vec3<N>) {
    let rotate = |a: N, b: N| {
        let norm = (a * a + b * b).root();
        (norm, a / norm, b / norm)
    };
    if v[0].value() != 0.0 {
        let (norm, c, s) = rotate(r[0], v[0]);
        let line = [c * r[1] + s * v[1], c * r[2] + s * v[2]];
        v = [N::of(0.0), c * v[1] - s * r[1], c * v[2] - s * r[2]];
        (r[0], r[1], r[2]) = (norm, line[0], line[1]);
    }
    if v[1].value() != 0.0 {
        let (norm, c, s) = rotate(r[3], v[1]);
        let line = c * r[4] + s * v[2];
        v[2] = c * v[2] - s * r[4];
        (r[3], r[4]) = (norm, line);
    }
    r[5] = (r[5] * r[5] + v[2] * v[2]).root();
}

impl<N: Num> State<N> {
    /// What an observation is charged for its errors.
    pub(super) fn charge(&self, o: usize, e: Option<Errors<N>>) -> N {
        let was_active = self.by_point[o].0 & OUT == 0;
        let limit = self.tau * N::of(if was_active { 1.0 } else { RETURN_SHARE as f32 });
        match e {
            Some(e) if self.worth(o, e) < limit && (was_active || self.is_inside(o, e).0) => self.worth(o, e),
            _ => self.tau,
        }
    }

    /// The unit ray of a pixel, as if there were no distortion.
    fn ray_of(&self, camera: usize, px: [N; 2]) -> Vec3<N> {
        let c = &self.intrinsics[camera];
        let bent: [N; 2] = std::array::from_fn(|k| (px[k] - c[2 + k]) / c[k]);
        let length = dot(&bent, &bent).root();
        match self.models[camera].family() {
            CameraFamily::Spherical => {
                let turn = [px[0] / c[0] - N::of(0.5), px[1] / c[1] - N::of(0.5)];
                let (x, y) = (turn[0] * N::of(TAU), turn[1] * N::of(PI));
                [x.sin() * y.cos(), y.sin(), x.cos() * y.cos()]
            }
            CameraFamily::Fisheye => {
                let share = if length.value() > 1e-6 { length.sin() / length } else { N::of(1.0) };
                [bent[0] * share, bent[1] * share, length.cos()]
            }
            CameraFamily::Perspective => {
                let ray = [bent[0], bent[1], N::of(1.0)];
                scale(ray, N::of(1.0) / dot(&ray, &ray).root())
            }
        }
    }

    fn between(&self, view: &View<N>, from: &View<N>) -> Vec3<N> {
        let cells = std::array::from_fn(|k| self.cell * N::of((view.cell[k] - from.cell[k]) as f32));
        add(cells, sub(view.center, from.center))
    }

    /// By point; `None` for those that are not looked at.
    pub(super) fn revive(&self) -> Vec<Option<Revived<N>>> {
        (0..self.num_points()).map(|p| self.revive_point(p)).collect()
    }

    fn revive_point(&self, p: usize) -> Option<Revived<N>> {
        let visible: Vec<usize> = self.track(p).filter(|&o| self.by_point[o].0 & HIDDEN == 0).collect();
        let counting = visible.iter().filter(|&&o| self.by_point[o].0 & OUT == 0).count();
        let poor = counting < 2 || 2 * counting < visible.len();
        if visible.len() < 2 || !(poor || self.revive_all && counting < visible.len()) {
            return None;
        }
        let origin = self.image(visible[0]);
        let center = |o: usize| self.between(&self.views[self.image(o)], &self.views[origin]);
        let mut before = -(N::of(LEAST_GAIN) * self.tau);
        let (mut a, mut b, mut rhs): (Vec3<N>, Vec3<N>, Vec3<N>) = (zero(), zero(), zero());
        for &o in &visible {
            let view = &self.views[self.image(o)];
            before += self.charge(o, self.errors(o, &self.points[p]));
            let ray = self.ray_of(view.camera, self.pixels[o]);
            let d = (0..3).map(|k| scale(view.rotation[k], ray[k])).reduce(add).expect("three rows");
            a = std::array::from_fn(|k| a[k] + (N::of(1.0) - d[k] * d[k]));
            b = sub(b, [d[0] * d[1], d[0] * d[2], d[1] * d[2]]);
            let c = center(o);
            rhs = add(rhs, sub(c, scale(d, dot(&d, &c))));
        }
        // The symmetric matrix (a0 b0 b1; b0 a1 b2; b1 b2 a2) by columns.
        let columns = [[a[0], b[0], b[1]], [b[0], a[1], b[2]], [b[1], b[2], a[2]]];
        let cofactors = [0, 1, 2].map(|k| cross(columns[(k + 1) % 3], columns[(k + 2) % 3]));
        let determinant = dot(&columns[0], &cofactors[0]);
        if determinant.value() <= 1e-12 {
            return None;
        }
        let mut v: Vec3<N> = cofactors.map(|c| dot(&c, &rhs) / determinant);
        let mut found = Revived { origin, from_center: v, before, best: before };
        for step in 0..=STEPS {
            let (cost, next) = self.step_alone(&visible, v, step > STEPS / 2, &center);
            if cost < found.best {
                found = Revived { from_center: v, best: cost, ..found };
            }
            let Some(next) = next else { break };
            v = next;
        }
        Some(found)
    }

    /// The cost at a position from the origin's centre, and where a Gauss–Newton step leads.
    fn step_alone(
        &self,
        visible: &[usize],
        v: Vec3<N>,
        within_limit: bool,
        center: &dyn Fn(usize) -> Vec3<N>,
    ) -> (N, Option<Vec3<N>>) {
        let (mut cost, mut used) = (N::of(0.0), 0);
        let (mut r, mut gradient): ([N; 6], Vec3<N>) = (zero(), zero());
        for &o in visible {
            let view = &self.views[self.image(o)];
            let q = rotate(view, sub(v, center(o)));
            let errors = self.errors_at(o, q);
            cost += self.charge(o, errors);
            let Some(e) = errors else { continue };
            let s = dot(&e[..2], &e[..2]);
            if within_limit && loss_value(self.loss, s) >= self.tau {
                continue;
            }
            let weight = loss_weight(self.loss, s).root();
            for (by_q, error) in self.differentiate(view.camera, q).0.into_iter().zip(e) {
                let row = (0..3).map(|k| scale(view.rotation[k], by_q[k])).reduce(add).expect("three rows");
                let row = scale(row, weight);
                fold_row(&mut r, row);
                gradient = add(gradient, scale(row, weight * error));
            }
            used += 1;
        }
        let diagonal = [r[0], r[3], r[5]].map(|v| v.value().abs());
        let (low, high) = diagonal.iter().fold((f64::INFINITY, 0.0f64), |(l, h), &v| (l.min(v), h.max(v)));
        if used < 2 || low * RANK_RATIO <= high {
            return (cost, None);
        }
        let norms = [r[0] * r[0], r[1] * r[1] + r[3] * r[3], r[2] * r[2] + r[4] * r[4] + r[5] * r[5]];
        for k in 0..3 {
            let mut row = zero();
            row[k] = N::of(LAMBDA).root() * norms[k].root();
            fold_row(&mut r, row);
        }
        let one = N::of(1.0);
        let mut block = [zero(); 6];
        block[4] = [one / r[0], r[1], r[2], N::of(0.0)];
        block[5] = [one / r[3], r[4], one / r[5], N::of(0.0)];
        let next = sub(v, solve_normal(&block, gradient));
        (cost, next.iter().all(|v| v.value().is_finite()).then_some(next))
    }
}
