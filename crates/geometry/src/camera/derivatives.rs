//! Derivatives of the projection: by hand for the models that fill real databases, by jets for the others.
//!
//! Division by the depth, focal lengths and principal point have the same derivatives in every model and are written
//! once; only the distortion differs. Jets then carry two unknowns and the distortion parameters, no more.

use super::equirectangular;
use super::jet::Jet;
use super::model::{CameraModel, MAX_PARAMS};
use super::projection::{MIN_DEPTH, Projection, distort};
use super::scalar::Real;

/// The largest number of distortion parameters of any model.
const MAX_EXTRA: usize = MAX_PARAMS - 4;

/// A distorted point with its derivatives by the undistorted point and by `E` distortion parameters.
struct Distorted<T, const E: usize> {
    point: [T; 2],
    d_point: [[T; 2]; 2],
    d_extra: [[T; E]; 2],
}

/// See [`super::project_with_derivatives`].
#[inline]
pub(super) fn project<T: Real>(model: CameraModel, params: &[T], point: [T; 3]) -> Option<Projection<T>> {
    if model == CameraModel::Equirectangular {
        return project_spherical(params, point);
    }
    let in_front = point[2].value() >= MIN_DEPTH;
    if !in_front {
        return None;
    }
    let params = &params[..model.num_params()];
    let inverse_depth = T::ONE / point[2];
    let (x, y) = (point[0] * inverse_depth, point[1] * inverse_depth);
    match model {
        CameraModel::SimplePinhole => Some(compose::<T, 1, 0>(params, x, y, inverse_depth, &undistorted(x, y))),
        CameraModel::Pinhole => Some(compose::<T, 2, 0>(params, x, y, inverse_depth, &undistorted(x, y))),
        CameraModel::SimpleRadial => {
            Some(compose::<T, 1, 1>(params, x, y, inverse_depth, &simple_radial(params[3], x, y)))
        }
        CameraModel::Radial => {
            Some(compose::<T, 1, 2>(params, x, y, inverse_depth, &radial(params[3], params[4], x, y)))
        }
        CameraModel::OpenCv => Some(compose::<T, 2, 4>(params, x, y, inverse_depth, &opencv(&params[4..8], x, y))),
        _ => project_rare(model, params, x, y, inverse_depth),
    }
}

/// The models that need jets, kept apart so that the frequent ones stay small enough to be inlined.
#[inline(never)]
fn project_rare<T: Real>(model: CameraModel, params: &[T], x: T, y: T, inverse_depth: T) -> Option<Projection<T>> {
    let one = |d: Distorted<T, 1>| compose::<T, 1, 1>(params, x, y, inverse_depth, &d);
    match model {
        CameraModel::SimpleFisheye => {
            Some(compose::<T, 1, 0>(params, x, y, inverse_depth, &by_jets::<T, 0, 2>(model, &params[3..], x, y)?))
        }
        CameraModel::Fisheye => {
            Some(compose::<T, 2, 0>(params, x, y, inverse_depth, &by_jets::<T, 0, 2>(model, &params[4..], x, y)?))
        }
        CameraModel::SimpleRadialFisheye | CameraModel::SimpleDivision => {
            Some(one(by_jets::<T, 1, 3>(model, &params[3..], x, y)?))
        }
        CameraModel::RadialFisheye => {
            Some(compose::<T, 1, 2>(params, x, y, inverse_depth, &by_jets::<T, 2, 4>(model, &params[3..], x, y)?))
        }
        CameraModel::Fov | CameraModel::Division => {
            Some(compose::<T, 2, 1>(params, x, y, inverse_depth, &by_jets::<T, 1, 3>(model, &params[4..], x, y)?))
        }
        CameraModel::Eucm => {
            Some(compose::<T, 2, 2>(params, x, y, inverse_depth, &by_jets::<T, 2, 4>(model, &params[4..], x, y)?))
        }
        CameraModel::OpenCvFisheye => {
            Some(compose::<T, 2, 4>(params, x, y, inverse_depth, &by_jets::<T, 4, 6>(model, &params[4..], x, y)?))
        }
        CameraModel::FullOpenCv | CameraModel::ThinPrismFisheye => {
            Some(compose::<T, 2, 8>(params, x, y, inverse_depth, &by_jets::<T, 8, 10>(model, &params[4..], x, y)?))
        }
        CameraModel::RadTanThinPrismFisheye => Some(compose::<T, 2, MAX_EXTRA>(
            params,
            x,
            y,
            inverse_depth,
            &by_jets::<T, MAX_EXTRA, { MAX_EXTRA + 2 }>(model, &params[4..], x, y)?,
        )),
        _ => None,
    }
}

/// Focal lengths (`F` of them), principal point and division by the depth around a distortion.
#[inline(always)]
fn compose<T: Real, const F: usize, const E: usize>(
    params: &[T],
    x: T,
    y: T,
    inverse_depth: T,
    distorted: &Distorted<T, E>,
) -> Projection<T> {
    let focal = [params[0], params[F - 1]];
    let mut out = Projection { pixel: [T::ZERO; 2], d_point: [[T::ZERO; 3]; 2], d_params: [[T::ZERO; MAX_PARAMS]; 2] };
    for row in 0..2 {
        let f = focal[row];
        out.pixel[row] = f * distorted.point[row] + params[F + row];
        let scale = f * inverse_depth;
        let [dx, dy] = distorted.d_point[row];
        // ∂(x, y)/∂(u, v, w) = [1 0 −x; 0 1 −y]/w.
        out.d_point[row] = [scale * dx, scale * dy, -scale * (dx * x + dy * y)];
        out.d_params[row][if F == 1 { 0 } else { row }] = distorted.point[row];
        out.d_params[row][F + row] = T::ONE;
        for i in 0..E {
            out.d_params[row][F + 2 + i] = f * distorted.d_extra[row][i];
        }
    }
    out
}

#[inline(always)]
fn undistorted<T: Real>(x: T, y: T) -> Distorted<T, 0> {
    Distorted { point: [x, y], d_point: [[T::ONE, T::ZERO], [T::ZERO, T::ONE]], d_extra: [[]; 2] }
}

#[inline(always)]
fn simple_radial<T: Real>(k: T, x: T, y: T) -> Distorted<T, 1> {
    let r2 = x * x + y * y;
    let factor = T::ONE + k * r2;
    // dfactor/d(r²), twice: the derivative by x is this times x.
    let slope = T::from_f64(2.0) * k;
    let mixed = slope * x * y;
    Distorted {
        point: [factor * x, factor * y],
        d_point: [[factor + slope * x * x, mixed], [mixed, factor + slope * y * y]],
        d_extra: [[r2 * x], [r2 * y]],
    }
}

#[inline(always)]
fn radial<T: Real>(k1: T, k2: T, x: T, y: T) -> Distorted<T, 2> {
    let two = T::from_f64(2.0);
    let r2 = x * x + y * y;
    let r4 = r2 * r2;
    let factor = T::ONE + r2 * (k1 + k2 * r2);
    let slope = two * (k1 + two * k2 * r2);
    let mixed = slope * x * y;
    Distorted {
        point: [factor * x, factor * y],
        d_point: [[factor + slope * x * x, mixed], [mixed, factor + slope * y * y]],
        d_extra: [[r2 * x, r4 * x], [r2 * y, r4 * y]],
    }
}

#[inline(always)]
fn opencv<T: Real>(extra: &[T], x: T, y: T) -> Distorted<T, 4> {
    let (two, three) = (T::from_f64(2.0), T::from_f64(3.0));
    let (p1, p2) = (extra[2], extra[3]);
    let Distorted { point, d_point, d_extra } = radial(extra[0], extra[1], x, y);
    let (x2, y2, two_xy) = (x * x, y * y, two * x * y);
    let (across_x, across_y) = (three * x2 + y2, x2 + three * y2);
    let mixed = two * (p1 * x + p2 * y);
    Distorted {
        point: [point[0] + p1 * two_xy + p2 * across_x, point[1] + p2 * two_xy + p1 * across_y],
        d_point: [
            [d_point[0][0] + two * (p1 * y + three * p2 * x), d_point[0][1] + mixed],
            [d_point[1][0] + mixed, d_point[1][1] + two * (p2 * x + three * p1 * y)],
        ],
        d_extra: [[d_extra[0][0], d_extra[0][1], two_xy, across_x], [d_extra[1][0], d_extra[1][1], across_y, two_xy]],
    }
}

/// Any distortion with `E` parameters through jets of `N = E + 2` unknowns.
#[inline(always)]
fn by_jets<T: Real, const E: usize, const N: usize>(
    model: CameraModel,
    extra: &[T],
    x: T,
    y: T,
) -> Option<Distorted<T, E>> {
    let seeded: [Jet<T, N>; E] = std::array::from_fn(|i| Jet::variable(extra[i], 2 + i));
    let point = distort(model, &seeded, Jet::variable(x, 0), Jet::variable(y, 1))?;
    Some(Distorted {
        point: point.map(|p| p.value),
        d_point: point.map(|p| [p.partials[0], p.partials[1]]),
        d_extra: point.map(|p| std::array::from_fn(|i| p.partials[2 + i])),
    })
}

#[inline(never)]
fn project_spherical<T: Real>(params: &[T], point: [T; 3]) -> Option<Projection<T>> {
    let point = std::array::from_fn(|i| Jet::<T, 5>::variable(point[i], i));
    let params = [Jet::variable(params[0], 3), Jet::variable(params[1], 4)];
    let pixel = equirectangular::project(&params, point)?;
    let mut out = Projection {
        pixel: pixel.map(|p| p.value),
        d_point: pixel.map(|p| [p.partials[0], p.partials[1], p.partials[2]]),
        d_params: [[T::ZERO; MAX_PARAMS]; 2],
    };
    for row in 0..2 {
        out.d_params[row][..2].copy_from_slice(&pixel[row].partials[3..]);
    }
    Some(out)
}
