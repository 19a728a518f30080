//! Twins of `perspective.wgsl`, `loss.wgsl` and `row.wgsl`.

use super::num::{Num, Vec3, add, cross, dot, scale, sub};
use super::state::{Point, State, View};

pub(super) fn distorted<N: Num>(k: &[N; 8], u: [N; 2]) -> [N; 2] {
    let (one, two) = (N::of(1.0), N::of(2.0));
    let n = dot(&u, &u);
    let d = one + n * (k[4] + k[5] * n);
    let xy = two * u[0] * u[1];
    [d * u[0] + (k[6] * xy + k[7] * (n + two * u[0] * u[0])), d * u[1] + (k[7] * xy + k[6] * (n + two * u[1] * u[1]))]
}

pub(super) fn rotate<N: Num>(view: &View<N>, v: Vec3<N>) -> Vec3<N> {
    view.rotation.map(|row| dot(&row, &v))
}

/// An observation's derivatives, weighted.
#[derive(Clone)]
pub(super) struct Row<N> {
    pub(super) point: [Vec3<N>; 2],
    pub(super) ray: Vec3<N>,
    pub(super) params: [[N; 8]; 2],
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

    pub(super) fn differentiate(&self, camera: usize, q: Vec3<N>) -> ([Vec3<N>; 2], [[N; 8]; 2]) {
        let c = &self.intrinsics[camera];
        let (zero, one, two, six) = (N::of(0.0), N::of(1.0), N::of(2.0), N::of(6.0));
        let inverse = one / q[2];
        let u = [q[0] * inverse, q[1] * inverse];
        let n = dot(&u, &u);
        let d = one + n * (c[4] + c[5] * n);
        let slope = two * (c[4] + two * c[5] * n);
        let mixed = slope * u[0] * u[1] + two * (c[6] * u[0] + c[7] * u[1]);
        let by_x = [(d + slope * u[0] * u[0] + two * c[6] * u[1] + six * c[7] * u[0]) * c[0], mixed * c[0]];
        let by_y = [mixed * c[1], (d + slope * u[1] * u[1] + two * c[7] * u[0] + six * c[6] * u[1]) * c[1]];
        let by_q = [by_x, by_y].map(|b| [b[0] * inverse, b[1] * inverse, -dot(&b, &u) * inverse]);
        let point = distorted(c, u);
        let xy = two * u[0] * u[1];
        let (xx, yy) = (n + two * u[0] * u[0], n + two * u[1] * u[1]);
        let fx = |v: N| c[0] * v;
        let fy = |v: N| c[1] * v;
        let x = [point[0], zero, one, zero, fx(n * u[0]), fx(n * n * u[0]), fx(xy), fx(xx)];
        let mut y = [zero, point[1], zero, one, fy(n * u[1]), fy(n * n * u[1]), fy(yy), fy(xy)];
        if self.single_focal[camera] {
            (y[0], y[1]) = (point[1], zero);
        }
        (by_q, [x, y])
    }

    /// The change of the pixel from the accepted to the tried intrinsics and from `q` to `q + dq`.
    pub(super) fn project_change(&self, camera: usize, q: Vec3<N>, dq: Vec3<N>) -> [N; 2] {
        let two = N::of(2.0);
        let (c, dc) = (&self.intrinsics[camera], &self.intrinsics[camera + 2 * self.cameras]);
        let u = [q[0] / q[2], q[1] / q[2]];
        let du: [N; 2] = std::array::from_fn(|k| (dq[k] - u[k] * dq[2]) / (q[2] + dq[2]));
        let u2 = add(u, du);
        let n = dot(&u, &u);
        let dn = dot(&du, &add(scale(u, two), du));
        let n2 = n + dn;
        let d = N::of(1.0) + n * (c[4] + c[5] * n);
        let dd = dc[4] * n2 + c[4] * dn + dc[5] * n2 * n2 + c[5] * dn * (n + n2);
        let dxy = two * (du[0] * u2[1] + u[0] * du[1]);
        let dsq: [N; 2] = std::array::from_fn(|k| two * du[k] * (two * u[k] + du[k]));
        let xy2 = two * u2[0] * u2[1];
        let sq2 = u2.map(|v| n2 + two * v * v);
        let moved = [
            dd * u2[0] + d * du[0] + (dc[6] * xy2 + c[6] * dxy + dc[7] * sq2[0] + c[7] * (dn + dsq[0])),
            dd * u2[1] + d * du[1] + (dc[7] * xy2 + c[7] * dxy + dc[6] * sq2[1] + c[6] * (dn + dsq[1])),
        ];
        let point = distorted(&add(*c, *dc), u2);
        std::array::from_fn(|k| dc[k] * point[k] + c[k] * moved[k] + dc[2 + k])
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
    /// `J_c x` for rotation, centre, two unused, eight parameters.
    pub(super) fn camera_product(&self, x: &[N; 16]) -> [N; 2] {
        let moved = sub(cross([x[0], x[1], x[2]], self.ray), [x[3], x[4], x[5]]);
        std::array::from_fn(|k| {
            dot(&self.point[k], &moved) + dot(&self.params[k][..4], &x[8..12]) + dot(&self.params[k][4..], &x[12..])
        })
    }

    /// `J_cᵀ e`, with `‖e‖²` in place 6.
    pub(super) fn camera_transposed(&self, e: [N; 2]) -> [N; 16] {
        let g = self.point_transposed(e);
        let w = cross(self.ray, g);
        let params: [N; 8] = std::array::from_fn(|k| self.params[0][k] * e[0] + self.params[1][k] * e[1]);
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
