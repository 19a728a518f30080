//! From a point in the camera frame to a pixel: one dispatch for values, derivatives and differences.

use super::derivatives;
use super::difference::Difference;
use super::model::{CameraFamily, CameraModel, MAX_PARAMS};
use super::scalar::{Real, Scalar};
use super::{division, equirectangular, eucm, fisheye, fov, opencv, radial, thin_prism};

/// COLMAP's smallest depth that counts as in front of the camera.
pub(super) const MIN_DEPTH: f64 = f64::EPSILON;

/// A projection with its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Projection<T> {
    /// The pixel.
    pub pixel: [T; 2],
    /// ∂pixel/∂point in the camera frame, 2 × 3, row-major.
    pub d_point: [[T; 3]; 2],
    /// ∂pixel/∂parameters, 2 × [`MAX_PARAMS`]; columns past the model's parameters are zero.
    pub d_params: [[T; MAX_PARAMS]; 2],
}

/// The pixel of a point in the camera frame (right, down, forward), or `None` where the model sees nothing
/// (at or behind the camera plane for all models but the equirectangular one, or outside a model's domain).
/// `params` holds at least the model's parameters.
#[inline]
pub fn project<T: Scalar>(model: CameraModel, params: &[T], point: [T; 3]) -> Option<[T; 2]> {
    if model == CameraModel::Equirectangular {
        return equirectangular::project(params, point);
    }
    // False for a depth of NaN too.
    let in_front = point[2].lowest() >= MIN_DEPTH;
    if !in_front {
        return None;
    }
    let params = &params[..model.num_params()];
    let (x, y) = (point[0] / point[2], point[1] / point[2]);
    match *model.focal_params() {
        [_] => {
            let [x, y] = distort(model, &params[3..], x, y)?;
            Some([params[0] * x + params[1], params[0] * y + params[2]])
        }
        _ => {
            let [x, y] = distort(model, &params[4..], x, y)?;
            Some([params[0] * x + params[2], params[1] * y + params[3]])
        }
    }
}

/// From the undistorted to the distorted point on the plane z = 1 (the pixel for focal length 1 and principal point 0).
#[inline(always)]
pub(super) fn distort<T: Scalar>(model: CameraModel, extra: &[T], x: T, y: T) -> Option<[T; 2]> {
    match model.family() {
        CameraFamily::Fisheye => {
            let [x, y] = fisheye::angles_from_plane(x, y);
            distort_model(model, extra, x, y)
        }
        _ => distort_model(model, extra, x, y),
    }
}

/// The distortion alone: on the plane z = 1, or in angle space for the fisheye models.
#[inline(always)]
pub(super) fn distort_model<T: Scalar>(model: CameraModel, extra: &[T], x: T, y: T) -> Option<[T; 2]> {
    match model {
        CameraModel::SimplePinhole | CameraModel::Pinhole | CameraModel::SimpleFisheye | CameraModel::Fisheye => {
            Some([x, y])
        }
        CameraModel::SimpleRadial | CameraModel::SimpleRadialFisheye => Some(radial::distort(&extra[..1], x, y)),
        CameraModel::Radial | CameraModel::RadialFisheye => Some(radial::distort(&extra[..2], x, y)),
        CameraModel::OpenCvFisheye => Some(radial::distort(&extra[..4], x, y)),
        CameraModel::OpenCv => Some(opencv::distort(extra, x, y)),
        CameraModel::FullOpenCv => opencv::distort_full(extra, x, y),
        CameraModel::Fov => Some(fov::distort(extra, x, y)),
        CameraModel::ThinPrismFisheye => Some(thin_prism::distort(extra, x, y)),
        CameraModel::RadTanThinPrismFisheye => Some(thin_prism::distort_rad_tan(extra, x, y)),
        CameraModel::SimpleDivision | CameraModel::Division => division::distort(extra, x, y),
        CameraModel::Eucm => eucm::distort(extra, x, y),
        CameraModel::Equirectangular => None,
    }
}

/// The pixel with its derivatives by the point and by the parameters; `None` exactly where [`project`] gives `None`.
#[inline]
pub fn project_with_derivatives<T: Real>(model: CameraModel, params: &[T], point: [T; 3]) -> Option<Projection<T>> {
    derivatives::project(model, params, point)
}

/// `project(params + d_params, point + d_point) − project(params, point)`, without cancellation; `None` where either
/// state does not project. For the equirectangular model the change takes the short way round the seam.
#[inline]
pub fn project_difference<T: Real>(
    model: CameraModel,
    params: &[T],
    d_params: &[T],
    point: [T; 3],
    d_point: [T; 3],
) -> Option<[T; 2]> {
    let mut both = [Difference::<T>::constant(0.0); MAX_PARAMS];
    for (both, (&p, &d)) in both.iter_mut().zip(params.iter().zip(d_params)) {
        *both = Difference::new(p, d);
    }
    let point = std::array::from_fn(|i| Difference::new(point[i], d_point[i]));
    let pixel = project(model, &both, point)?;
    Some([pixel[0].change, pixel[1].change])
}
