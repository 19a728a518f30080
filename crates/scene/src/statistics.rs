//! Numbers that describe a reconstruction, and the errors stored with its points.

use epipole_geometry::camera::Camera;
use serde::Serialize;

use crate::filter::observation_error_px;
use crate::{Image, Point, Reconstruction};

/// A summary of a reconstruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Posed images.
    pub images: usize,
    /// Points.
    pub points: usize,
    /// Observations of all points.
    pub observations: usize,
    /// Observations per point; 0 without points.
    pub mean_track_length: f64,
    /// Observations per posed image; 0 without images.
    pub mean_observations_per_image: f64,
    /// Mean of the points' stored errors, px, each point counting once: what COLMAP prints. 0 if no error is known.
    pub mean_reprojection_error_px: f64,
    /// The same, each point counting as often as it is observed, px.
    pub mean_observation_error_px: f64,
}

impl Statistics {
    /// Of a reconstruction whose points have their errors (see [`update_point_errors`]).
    pub fn of(reconstruction: &Reconstruction) -> Self {
        let (mut per_point, mut known_points) = (0.0, 0usize);
        let (mut per_observation, mut known_observations) = (0.0, 0usize);
        for point in reconstruction.points.iter().filter(|p| p.error_px >= 0.0) {
            let length = point.observations.len();
            per_point += point.error_px;
            known_points += 1;
            per_observation += point.error_px * length as f64;
            known_observations += length;
        }
        let (images, points) = (reconstruction.images.len(), reconstruction.points.len());
        let observations = reconstruction.num_observations();
        Self {
            images,
            points,
            observations,
            mean_track_length: ratio(observations as f64, points),
            mean_observations_per_image: ratio(observations as f64, images),
            mean_reprojection_error_px: ratio(per_point, known_points),
            mean_observation_error_px: ratio(per_observation, known_observations),
        }
    }
}

/// The reprojection errors of an image's observations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImageErrors {
    /// Observations of points.
    pub observations: usize,
    /// Sum of their errors, px; infinite where one does not project.
    pub sum_px: f64,
}

impl ImageErrors {
    /// Of every image of a reconstruction, in its order.
    pub fn of(reconstruction: &Reconstruction) -> Vec<Self> {
        let mut errors = vec![Self::default(); reconstruction.images.len()];
        for point in &reconstruction.points {
            for &o in &point.observations {
                let image = &mut errors[o.image as usize];
                image.observations += 1;
                image.sum_px += reconstruction.reprojection_error_px(point, o);
            }
        }
        errors
    }

    /// Their mean, px; `None` without observations.
    pub fn mean_px(&self) -> Option<f64> {
        (self.observations > 0).then(|| self.sum_px / self.observations as f64)
    }
}

fn ratio(sum: f64, count: usize) -> f64 {
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// The mean reprojection error of a point over its observations, px, as COLMAP stores it; infinite if an observation
/// does not project, −1 without observations.
pub fn point_error_px(cameras: &[Camera], images: &[Image], point: &Point) -> f64 {
    if point.observations.is_empty() {
        return -1.0;
    }
    let sum: f64 = point.observations.iter().map(|&o| observation_error_px(cameras, images, point.position, o)).sum();
    sum / point.observations.len() as f64
}

/// Sets every point's error. Returns the number of points with an observation that does not project: their error is
/// infinite, and a filter by pixels would remove that observation.
pub fn update_point_errors(reconstruction: &mut Reconstruction) -> usize {
    let Reconstruction { cameras, images, points, .. } = reconstruction;
    let mut broken = 0;
    for point in points {
        point.error_px = point_error_px(cameras, images, point);
        broken += usize::from(!point.error_px.is_finite());
    }
    broken
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::fixture::{row_of_cameras, shift_keypoint};

    #[test]
    fn means_are_over_points_and_over_observations() {
        let mut r = row_of_cameras(4, 3);
        r.points[1].observations.truncate(2);
        shift_keypoint(&mut r, 0, 1, DVec2::new(3.0, 4.0));
        shift_keypoint(&mut r, 2, 2, DVec2::new(0.0, 1.0));
        assert_eq!(update_point_errors(&mut r), 0);
        let errors: Vec<f64> = r.points.iter().map(|p| p.error_px).collect();
        for (error, expected) in errors.iter().zip([0.0, 2.5, 0.25]) {
            assert!((error - expected).abs() < 1e-12, "{errors:?}");
        }
        let found = Statistics::of(&r);
        assert_eq!((found.images, found.points, found.observations), (4, 3, 10));
        assert!((found.mean_track_length - 10.0 / 3.0).abs() < 1e-15);
        assert!((found.mean_observations_per_image - 2.5).abs() < 1e-15);
        assert!((found.mean_reprojection_error_px - 2.75 / 3.0).abs() < 1e-12);
        assert!((found.mean_observation_error_px - 0.6).abs() < 1e-12);
    }

    #[test]
    fn points_that_do_not_project_are_counted() {
        let mut r = row_of_cameras(2, 2);
        r.points[0].position = DVec3::new(0.0, 0.0, -1.0);
        r.points[1].observations.clear();
        assert_eq!(update_point_errors(&mut r), 1);
        assert_eq!(r.points[0].error_px, f64::INFINITY);
        assert_eq!(r.points[1].error_px, -1.0);
        assert_eq!(Statistics::of(&Reconstruction::default()), Statistics::default());
    }
}
