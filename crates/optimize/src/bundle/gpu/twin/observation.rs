//! Twins of `loss.wgsl` and `row.wgsl`.

use epipole_geometry::camera::MAX_PARAMS;

use super::num::{Num, Vec3, add, cross, dot, scale, sub};
use super::state::{Point, State, Step, View};

pub(super) fn rotate<N: Num>(view: &View<N>, v: Vec3<N>) -> Vec3<N> {
    view.rotation.map(|row| dot(&row, &v))
}

/// An observation's derivatives, weighted.
#[derive(Clone)]
pub(super) struct Row<N> {
    pub(super) point: [Vec3<N>; 2],
    pub(super) ray: Vec3<N>,
    pub(super) params: [[N; MAX_PARAMS]; 2],
}

impl<N: Num> State<N> {
    pub(super) fn ray(&self, point: &Point<N>, view: &View<N>) -> Vec3<N> {
        let cells = std::array::from_fn(|k| self.cell * N::of((point.cell[k] - view.cell[k]) as f32));
        add(cells, sub(point.offset, view.center))
    }

    pub(super) fn row(&self, point: usize, image: usize, weight: N) -> Row<N> {
        let view = &self.views[image];
        let ray = self.ray(&self.points[point], view);
        let (by_q, params) = self.differentiate(view.camera, rotate(view, ray));
        let by_point = by_q.map(|d| {
            let rows = (0..3).map(|k| scale(view.rotation[k], d[k])).reduce(add);
            scale(rows.expect("three rows"), weight)
        });
        Row { point: by_point, ray, params: params.map(|row| scale(row, weight)) }
    }

    pub(super) fn loss_value(&self, s: N) -> N {
        let (kind, scale) = self.loss;
        match kind {
            1 if s.value() > (scale * scale).value() => scale * (N::of(2.0) * s.root() - scale),
            2 => scale * scale * (s / (scale * scale)).ln(),
            3 => s / (N::of(1.0) + s / (scale * scale)),
            _ => s,
        }
    }

    pub(super) fn loss_weight(&self, s: N) -> N {
        let (kind, scale) = self.loss;
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

    pub(super) fn loss_difference(&self, s: N, change: N) -> N {
        let (kind, scale) = self.loss;
        let limit = (scale * scale).value();
        let after = s + change;
        match kind {
            1 => match (s.value() > limit, after.value() > limit) {
                (true, true) => N::of(2.0) * scale * change / (s.root() + after.root()),
                (false, false) => change,
                _ => self.loss_value(after) - self.loss_value(s),
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
}

impl<N: Num> Row<N> {
    /// `J_c x` for rotation, centre, two unused, parameters.
    pub(super) fn camera_product(&self, x: &Step<N>) -> [N; 2] {
        let moved = sub(cross([x[0], x[1], x[2]], self.ray), [x[3], x[4], x[5]]);
        std::array::from_fn(|k| dot(&self.point[k], &moved) + dot(&self.params[k], &x[8..]))
    }

    /// `J_cᵀ e`, with `‖e‖²` in place 6.
    pub(super) fn camera_transposed(&self, e: [N; 2]) -> Step<N> {
        let g = self.point_transposed(e);
        let w = cross(self.ray, g);
        let params: [N; MAX_PARAMS] = std::array::from_fn(|k| self.params[0][k] * e[0] + self.params[1][k] * e[1]);
        let head = [w[0], w[1], w[2], -g[0], -g[1], -g[2], dot(&e, &e), N::of(0.0)];
        std::array::from_fn(|k| if k < 8 { head[k] } else { params[k - 8] })
    }

    pub(super) fn point_transposed(&self, e: [N; 2]) -> Vec3<N> {
        std::array::from_fn(|k| self.point[0][k] * e[0] + self.point[1][k] * e[1])
    }

    pub(super) fn point_product(&self, y: Vec3<N>) -> [N; 2] {
        self.point.map(|row| dot(&row, &y))
    }
}
