//! From a pixel to the bearing seen there: closed forms where the model has one, otherwise Newton's method.

use glam::{DMat2, DVec2, DVec3};

use super::jet::Jet;
use super::model::{CameraFamily, CameraModel, MAX_PARAMS};
use super::projection::distort_model;
use super::scalar::Scalar;
use super::{division, equirectangular, eucm, fisheye, fov};

/// Newton iterations at most (source: `algorithms.md` §3.5, iterative undistortion).
const MAX_ITERATIONS: usize = 100;

/// A squared step below this ends the search (same source).
const STEP_TOLERANCE2: f64 = 1e-10;

/// A step is at most this, or this fraction of the distance from the axis (same source).
const STEP_LIMIT: f64 = 0.1;

/// Newton steps after the search has ended: from 1e-5 to rounding, as each step squares the error.
const POLISHING_STEPS: usize = 2;

/// The unit bearing in the camera frame that projects to a pixel; `None` where the distortion has no inverse,
/// the ray does not point forward (all models but the equirectangular one), or a number is not finite.
pub(super) fn ray_from_pixel(model: CameraModel, params: &[f64], px: DVec2) -> Option<DVec3> {
    if !px.is_finite() {
        return None;
    }
    let (focal_px, center_px, extra) = match (model.focal_params().len(), params) {
        (0, _) => return Some(equirectangular::ray_from_pixel(params, px)),
        (1, &[f, cx, cy, ref extra @ ..]) => (DVec2::splat(f), DVec2::new(cx, cy), extra),
        (_, &[fx, fy, cx, cy, ref extra @ ..]) => (DVec2::new(fx, fy), DVec2::new(cx, cy), extra),
        _ => return None,
    };
    let plane = undistort(model, extra, (px - center_px) / focal_px)?;
    plane.extend(1.0).try_normalize()
}

/// From the distorted to the undistorted point on the plane z = 1.
fn undistort(model: CameraModel, extra: &[f64], distorted: DVec2) -> Option<DVec2> {
    match model {
        CameraModel::SimplePinhole | CameraModel::Pinhole => Some(distorted),
        CameraModel::SimpleFisheye | CameraModel::Fisheye => fisheye::plane_from_angles(distorted),
        CameraModel::Fov => fov::undistort(extra[0], distorted),
        CameraModel::SimpleDivision | CameraModel::Division => division::undistort(extra[0], distorted),
        CameraModel::Eucm => eucm::undistort(extra[0], extra[1], distorted),
        CameraModel::SimpleRadial | CameraModel::SimpleRadialFisheye => by_newton::<1>(model, extra, distorted),
        CameraModel::Radial | CameraModel::RadialFisheye => by_newton::<2>(model, extra, distorted),
        CameraModel::OpenCv | CameraModel::OpenCvFisheye => by_newton::<4>(model, extra, distorted),
        CameraModel::FullOpenCv | CameraModel::ThinPrismFisheye => by_newton::<8>(model, extra, distorted),
        CameraModel::RadTanThinPrismFisheye => by_newton::<{ MAX_PARAMS - 4 }>(model, extra, distorted),
        CameraModel::Equirectangular => None,
    }
}

/// Solves `distort(x) = distorted`, in angle space for the fisheye models.
fn by_newton<const E: usize>(model: CameraModel, extra: &[f64], distorted: DVec2) -> Option<DVec2> {
    let extra: [Jet<f64, 2>; E] = std::array::from_fn(|i| Jet::constant(extra[i]));
    let newton_step = |x: DVec2| -> Option<DVec2> {
        let [u, v] = distort_model(model, &extra, Jet::variable(x.x, 0), Jet::variable(x.y, 1))?;
        let jacobian = DMat2::from_cols_array(&[u.partials[0], v.partials[0], u.partials[1], v.partials[1]]);
        let determinant = jacobian.determinant();
        // Where the determinant changes its sign the distortion folds back, and what lies behind the fold is not the
        // ray that the lens sends to this pixel.
        (determinant > 0.0).then(|| jacobian.inverse() * (distorted - DVec2::new(u.value, v.value)))
    };
    let mut x = distorted;
    let mut converged = false;
    for _ in 0..MAX_ITERATIONS {
        let Some(step) = newton_step(x) else {
            // The start may lie behind the fold while the solution does not: come closer to the axis.
            x *= 0.5;
            continue;
        };
        let limit = STEP_LIMIT.max(STEP_LIMIT * x.length());
        x += step.clamp_length_max(limit);
        if step.length_squared() < STEP_TOLERANCE2 {
            converged = true;
            break;
        }
    }
    for _ in 0..POLISHING_STEPS {
        x += newton_step(x)?;
    }
    if !converged || !x.is_finite() {
        return None;
    }
    if model.family() == CameraFamily::Fisheye { fisheye::plane_from_angles(x) } else { Some(x) }
}
