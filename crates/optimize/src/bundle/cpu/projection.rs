//! Projection for the optimiser: as the camera sees, or through the centre for points behind it as well.
//!
//! A line through the centre meets the image plane in one pixel whichever side the point is on: `project(−q)` is the
//! pixel of a point behind the camera. Reference solvers of BAL problems count such observations.

use epipole_geometry::camera::{CameraModel, Projection, Real, project, project_difference, project_with_derivatives};

use super::small::Vec3;

/// What counts as a valid projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// What the camera can see.
    Front,
    /// Every point, projected through the centre.
    Both,
}

impl Side {
    #[inline(always)]
    fn is_behind<T: Real>(self, model: CameraModel, q: &Vec3<T>) -> bool {
        self == Self::Both && model != CameraModel::Equirectangular && q[2] < T::ZERO
    }

    /// The pixel.
    #[inline(always)]
    pub(super) fn project<T: Real>(self, model: CameraModel, params: &[T], q: Vec3<T>) -> Option<[T; 2]> {
        let q = if self.is_behind(model, &q) { q.map(|v| -v) } else { q };
        project(model, params, q)
    }

    /// The pixel and its derivatives.
    #[inline(always)]
    pub(super) fn differentiate<T: Real>(self, model: CameraModel, params: &[T], q: Vec3<T>) -> Option<Projection<T>> {
        if !self.is_behind(model, &q) {
            return project_with_derivatives(model, params, q);
        }
        let mut projection = project_with_derivatives(model, params, q.map(|v| -v))?;
        projection.d_point = projection.d_point.map(|row| row.map(|v| -v));
        Some(projection)
    }

    /// The change of the pixel, without cancellation where both states are on one side of the camera.
    #[inline(always)]
    pub(super) fn difference<T: Real>(
        self,
        model: CameraModel,
        params: &[T],
        d_params: &[T],
        q: Vec3<T>,
        d_q: Vec3<T>,
    ) -> Option<[T; 2]> {
        let after = [q[0] + d_q[0], q[1] + d_q[1], q[2] + d_q[2]];
        match (self.is_behind(model, &q), self.is_behind(model, &after)) {
            (false, false) => project_difference(model, params, d_params, q, d_q),
            (true, true) => project_difference(model, params, d_params, q.map(|v| -v), d_q.map(|v| -v)),
            _ => {
                let mut params_after = [T::ZERO; epipole_geometry::camera::MAX_PARAMS];
                params_after.iter_mut().zip(params.iter().zip(d_params)).for_each(|(p, (&a, &d))| *p = a + d);
                let pixel = self.project(model, &params_after, after)?;
                let before = self.project(model, params, q)?;
                Some([pixel[0] - before[0], pixel[1] - before[1]])
            }
        }
    }
}
