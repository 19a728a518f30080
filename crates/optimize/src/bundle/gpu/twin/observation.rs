//! Twins of `loss.wgsl` and `row.wgsl`.

use epipole_geometry::camera::MAX_PARAMS;

use super::num::{Num, Vec3, add, cross, dot, scale, sub, zero};
use super::state::{Measured, Point, State, Step, View};

pub(super) fn rotate<N: Num>(view: &View<N>, v: Vec3<N>) -> Vec3<N> {
    view.rotation.map(|row| dot(&row, &v))
}

/// The rows of an observation: the pixel's two and the inverse depth's, which is zero where the depth is unknown.
pub(super) type Errors<N> = [N; 3];
/// Roots of the weights of pixel and inverse depth.
pub(super) type Weights<N> = [N; 2];

/// Errors multiplied by the roots of their weights.
pub(super) fn weighted<N: Num>(weights: Weights<N>, e: Errors<N>) -> Errors<N> {
    [weights[0] * e[0], weights[0] * e[1], weights[1] * e[2]]
}

/// An observation's derivatives, weighted.
#[derive(Clone)]
pub(super) struct Row<N> {
    pub(super) point: [Vec3<N>; 3],
    pub(super) ray: Vec3<N>,
    pub(super) params: [[N; MAX_PARAMS]; 2],
}

impl<N: Num> State<N> {
    pub(super) fn ray(&self, point: &Point<N>, view: &View<N>) -> Vec3<N> {
        let cells = std::array::from_fn(|k| self.cell * N::of((point.cell[k] - view.cell[k]) as f32));
        add(cells, sub(point.offset, view.center))
    }

    pub(super) fn row(&self, point: usize, image: usize, weights: Weights<N>) -> Row<N> {
        let view = &self.views[image];
        let ray = self.ray(&self.points[point], view);
        let q = rotate(view, ray);
        let (by_q, params) = self.differentiate(view.camera, q);
        let [x, y] = by_q.map(|d| {
            let rows = (0..3).map(|k| scale(view.rotation[k], d[k])).reduce(add);
            scale(rows.expect("three rows"), weights[0])
        });
        let has_depth = weights[1].value() != 0.0;
        let z = if has_depth { scale(view.rotation[2], -(weights[1] / (q[2] * q[2]))) } else { zero() };
        Row { point: [x, y, z], ray, params: params.map(|row| scale(row, weights[0])) }
    }

    /// What an observation costs.
    pub(super) fn cost(&self, measured: Measured<N>, e: Errors<N>) -> N {
        let sigmas = measured.weight * e[2];
        loss_value(self.loss, dot(&e[..2], &e[..2])) + loss_value(self.depth_loss, sigmas * sigmas)
    }

    /// What the depth of an observation can cost at most, where that is bounded.
    pub(super) fn depth_bound(&self, measured: Measured<N>) -> N {
        let (kind, scale) = self.depth_loss;
        if kind == 3 && measured.weight.value() > 0.0 { scale * scale } else { N::of(0.0) }
    }

    /// The change of the cost from the change of the errors.
    pub(super) fn cost_change(&self, measured: Measured<N>, e: Errors<N>, change: Errors<N>) -> N {
        let two = N::of(2.0);
        let ([a, b], [x, y]) = ([e[0], e[1]], [change[0], change[1]]);
        let pixel = loss_difference(self.loss, dot(&[a, b], &[a, b]), dot(&[x, y], &[two * a + x, two * b + y]));
        let (sigmas, more) = (measured.weight * e[2], measured.weight * change[2]);
        pixel + loss_difference(self.depth_loss, sigmas * sigmas, more * (two * sigmas + more))
    }
}

/// The functions of `loss.wgsl`, of a loss's number and scale.
pub(super) fn loss_value<N: Num>((kind, scale): (u32, N), s: N) -> N {
    match kind {
        1 if s.value() > (scale * scale).value() => scale * (N::of(2.0) * s.root() - scale),
        2 => scale * scale * (s / (scale * scale)).ln(),
        3 => s / (N::of(1.0) + s / (scale * scale)),
        _ => s,
    }
}

pub(super) fn loss_weight<N: Num>((kind, scale): (u32, N), s: N) -> N {
    match kind {
        1 if s.value() > (scale * scale).value() => scale / s.root(),
        2 => N::of(1.0) / (N::of(1.0) + s / (scale * scale)),
        3 => {
            let root = N::of(1.0) / (N::of(1.0) + s / (scale * scale));
            root * root
        }
        _ => N::of(1.0),
    }
}

pub(super) fn loss_difference<N: Num>((kind, scale): (u32, N), s: N, change: N) -> N {
    let limit = (scale * scale).value();
    let after = s + change;
    match kind {
        1 => match (s.value() > limit, after.value() > limit) {
            (true, true) => N::of(2.0) * scale * change / (s.root() + after.root()),
            (false, false) => change,
            _ => loss_value((kind, scale), after) - loss_value((kind, scale), s),
        },
        2 => scale * scale * (change / (scale * scale + s)).ln(),
        3 => {
            let one = N::of(1.0);
            let inverse = one / (scale * scale);
            change / ((one + s * inverse) * (one + after * inverse))
        }
        _ => change,
    }
}

impl<N: Num> Row<N> {
    /// `J_c x` for rotation, centre, two unused, parameters.
    pub(super) fn camera_product(&self, x: &Step<N>) -> Errors<N> {
        let moved = sub(cross([x[0], x[1], x[2]], self.ray), [x[3], x[4], x[5]]);
        let [a, b, c] = self.point.map(|row| dot(&row, &moved));
        [a + dot(&self.params[0], &x[8..]), b + dot(&self.params[1], &x[8..]), c]
    }

    /// `J_cᵀ e`, with `‖e‖²` in place 6.
    pub(super) fn camera_transposed(&self, e: Errors<N>) -> Step<N> {
        let g = self.point_transposed(e);
        let w = cross(self.ray, g);
        let params: [N; MAX_PARAMS] = std::array::from_fn(|k| self.params[0][k] * e[0] + self.params[1][k] * e[1]);
        let head = [w[0], w[1], w[2], -g[0], -g[1], -g[2], dot(&e, &e), N::of(0.0)];
        std::array::from_fn(|k| if k < 8 { head[k] } else { params[k - 8] })
    }

    pub(super) fn point_transposed(&self, e: Errors<N>) -> Vec3<N> {
        let [x, y, z] = self.point;
        std::array::from_fn(|k| x[k] * e[0] + y[k] * e[1] + z[k] * e[2])
    }

    pub(super) fn point_product(&self, y: Vec3<N>) -> Errors<N> {
        self.point.map(|row| dot(&row, &y))
    }
}
