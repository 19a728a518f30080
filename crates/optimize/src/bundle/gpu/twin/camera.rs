//! Twins of the camera models: `perspective.wgsl` by its own formulas, `camera/models.wgsl` by `epipole_geometry`, whose
//! cameras run on any scalar.

use epipole_geometry::camera::{MAX_PARAMS, Projection, project, project_difference, project_with_derivatives};

use super::num::{Num, Vec3, add, dot, scale};
use super::state::State;
use crate::bundle::gpu::records::param_slot;

type Params<N> = [N; MAX_PARAMS];

fn distorted<N: Num>(k: &Params<N>, u: [N; 2]) -> [N; 2] {
    let (one, two) = (N::of(1.0), N::of(2.0));
    let n = dot(&u, &u);
    let d = one + n * (k[4] + k[5] * n);
    let xy = two * u[0] * u[1];
    [d * u[0] + (k[6] * xy + k[7] * (n + two * u[0] * u[0])), d * u[1] + (k[7] * xy + k[6] * (n + two * u[1] * u[1]))]
}

impl<N: Num> State<N> {
    pub(super) fn is_wide(&self) -> bool {
        self.sizes.params == MAX_PARAMS
    }

    /// Parameters in the model's own order.
    fn params(&self, record: usize) -> Params<N> {
        let model = self.models[record];
        let at = |k| if k < model.num_params() { self.intrinsics[record][param_slot(model, k)] } else { N::of(0.0) };
        std::array::from_fn(at)
    }

    /// Projection minus pixel; `None` where the model sees nothing.
    pub(super) fn project_residual(&self, camera: usize, q: Vec3<N>, px: [N; 2]) -> Option<[N; 2]> {
        if self.is_wide() {
            let [x, y] = project(self.models[camera], &self.params(camera), q)?;
            return Some([x - px[0], y - px[1]]);
        }
        let c = &self.intrinsics[camera];
        let point = distorted(c, [q[0] / q[2], q[1] / q[2]]);
        let r = std::array::from_fn(|k| c[k] * point[k] + (c[2 + k] - px[k]));
        (q[2].value() > 0.0).then_some(r)
    }

    /// Derivatives by the point and by the parameters, these in the order of the records.
    pub(super) fn differentiate(&self, camera: usize, q: Vec3<N>) -> ([Vec3<N>; 2], [Params<N>; 2]) {
        if !self.is_wide() {
            return self.differentiate_narrow(camera, q);
        }
        let model = self.models[camera];
        let derivatives = project_with_derivatives(model, &self.params(camera), q);
        let Projection { d_point, d_params, .. } = derivatives.expect("an observation that counts");
        let mut params = [[N::of(0.0); MAX_PARAMS]; 2];
        for (out, found) in params.iter_mut().zip(&d_params) {
            (0..model.num_params()).for_each(|k| out[param_slot(model, k)] = found[k]);
        }
        (d_point, params)
    }

    fn differentiate_narrow(&self, camera: usize, q: Vec3<N>) -> ([Vec3<N>; 2], [Params<N>; 2]) {
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
        let wide = |row: [N; 8]| std::array::from_fn(|k| row.get(k).copied().unwrap_or(zero));
        (by_q, [wide(x), wide(y)])
    }

    /// The change of the pixel from the accepted to the tried intrinsics and from `q` to `q + dq`; `None` where the
    /// tried state sees nothing.
    pub(super) fn project_change(&self, camera: usize, q: Vec3<N>, dq: Vec3<N>) -> Option<[N; 2]> {
        if self.is_wide() {
            let change = self.params(camera + 2 * self.cameras);
            return project_difference(self.models[camera], &self.params(camera), &change, q, dq);
        }
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
        let change = std::array::from_fn(|k| dc[k] * point[k] + c[k] * moved[k] + dc[2 + k]);
        ((q[2] + dq[2]).value() > 0.0).then_some(change)
    }
}
