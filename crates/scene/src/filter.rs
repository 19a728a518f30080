//! Removes observations that contradict their point, and points that too few observations support.
//!
//! Each rule is a pure function of one point, so that a caller can run it over points in parallel; the functions over a
//! whole reconstruction do the same one after another. A point is removed as a whole as soon as fewer than two
//! observations would remain (source: `algorithms.md` §2.8, column C).

use std::ops::AddAssign;

use epipole_geometry::camera::{Camera, CameraFamily};
use epipole_geometry::triangulation::has_triangulation_angle;
use glam::DVec3;

use crate::{Image, Observation, Point, Reconstruction};

/// Depths below this count as behind the camera (source: `algorithms.md` §2.8).
const MIN_DEPTH: f64 = 1e-12;

/// What a filter took away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Removed {
    /// Observations, including all those of removed points.
    pub observations: usize,
    /// Points.
    pub points: usize,
}

impl AddAssign for Removed {
    fn add_assign(&mut self, other: Self) {
        self.observations += other.observations;
        self.points += other.points;
    }
}

impl std::iter::Sum for Removed {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |mut sum, part| {
            sum += part;
            sum
        })
    }
}

/// Distance on the plane z = 1 between a point in the camera frame and a unit bearing (unitless, about radians near the
/// axis); infinite where the point is behind the camera or the bearing does not point forward. A spherical camera has no
/// such plane and takes the one across its bearing.
pub fn normalized_error(family: CameraFamily, point_in_cam: DVec3, ray_in_cam: DVec3) -> f64 {
    if family == CameraFamily::Spherical {
        let along = point_in_cam.dot(ray_in_cam);
        return if along >= MIN_DEPTH { point_in_cam.cross(ray_in_cam).length() / along } else { f64::INFINITY };
    }
    if point_in_cam.z >= MIN_DEPTH && ray_in_cam.z > 0.0 {
        (point_in_cam.truncate() / point_in_cam.z).distance(ray_in_cam.truncate() / ray_in_cam.z)
    } else {
        f64::INFINITY
    }
}

/// Angle between the direction to a point in the camera frame and a bearing, rad; 0 to π. A point at the centre counts
/// as π away.
pub fn angular_error_rad(point_in_cam: DVec3, ray_in_cam: DVec3) -> f64 {
    let (sine, cosine) = (point_in_cam.cross(ray_in_cam).length(), point_in_cam.dot(ray_in_cam));
    if sine == 0.0 && cosine <= 0.0 { std::f64::consts::PI } else { sine.atan2(cosine) }
}

/// Drops the observations whose error exceeds a limit; NaN exceeds every limit. The point is left without observations
/// if fewer than two would remain: the caller then removes it.
pub fn filter_point_by(point: &mut Point, max_error: f64, error: impl Fn(DVec3, Observation) -> f64) -> Removed {
    let before = point.observations.len();
    let position = point.position;
    point.observations.retain(|&o| error(position, o) <= max_error);
    if point.observations.len() < 2 {
        point.observations.clear();
    }
    let after = point.observations.len();
    Removed { observations: before - after, points: usize::from(after == 0) }
}

/// Drops the observations that are farther than `max_error` from the projection on the plane z = 1; see
/// [`filter_point_by`]. `ray_in_cam` gives an observation's unit bearing, `None` where its pixel has none.
pub fn filter_point_normalized(
    cameras: &[Camera],
    images: &[Image],
    ray_in_cam: impl Fn(Observation) -> Option<DVec3>,
    max_error: f64,
    point: &mut Point,
) -> Removed {
    filter_point_by(point, max_error, |position, o| {
        let image = &images[o.image as usize];
        let in_cam = image.cam_from_world.transform_point(position);
        ray_in_cam(o).map_or(f64::INFINITY, |ray| normalized_error(cameras[image.camera].model.family(), in_cam, ray))
    })
}

/// Drops the observations whose bearing is more than `max_error_rad` away from the direction to the point; see
/// [`filter_point_by`].
pub fn filter_point_angular(
    images: &[Image],
    ray_in_cam: impl Fn(Observation) -> Option<DVec3>,
    max_error_rad: f64,
    point: &mut Point,
) -> Removed {
    filter_point_by(point, max_error_rad, |position, o| {
        let in_cam = images[o.image as usize].cam_from_world.transform_point(position);
        ray_in_cam(o).map_or(f64::INFINITY, |ray| angular_error_rad(in_cam, ray))
    })
}

/// Drops the observations that are more than `max_error_px` from the projection; see [`filter_point_by`].
pub fn filter_point_pixel(cameras: &[Camera], images: &[Image], max_error_px: f64, point: &mut Point) -> Removed {
    filter_point_by(point, max_error_px, |position, o| observation_error_px(cameras, images, position, o))
}

/// Drops a point that no pair of its images sees under at least `min_angle_rad` (`min(θ, π − θ)`); see
/// [`filter_point_by`]. `centers` holds the camera centre of every image.
pub fn filter_point_triangulation_angle(centers: &[DVec3], min_angle_rad: f64, point: &mut Point) -> Removed {
    let seen_from = point.observations.iter().map(|o| centers[o.image as usize]);
    if has_triangulation_angle(seen_from, point.position, min_angle_rad) {
        return Removed::default();
    }
    let observations = point.observations.len();
    point.observations.clear();
    Removed { observations, points: 1 }
}

/// Reprojection error of one observation, px; infinite where the point does not project.
pub fn observation_error_px(cameras: &[Camera], images: &[Image], position: DVec3, observation: Observation) -> f64 {
    let image = &images[observation.image as usize];
    let in_cam = image.cam_from_world.transform_point(position);
    cameras[image.camera].reprojection_error_px(in_cam, image.keypoints_px[observation.keypoint as usize])
}

/// [`filter_point_normalized`] on every point, with bearings from the present intrinsics.
pub fn filter_normalized(reconstruction: &mut Reconstruction, max_error: f64) -> Removed {
    filter_all(reconstruction, |cameras, images, point| {
        filter_point_normalized(cameras, images, |o| ray_in_cam(cameras, images, o), max_error, point)
    })
}

/// [`filter_point_angular`] on every point, with bearings from the present intrinsics.
pub fn filter_angular(reconstruction: &mut Reconstruction, max_error_rad: f64) -> Removed {
    filter_all(reconstruction, |cameras, images, point| {
        filter_point_angular(images, |o| ray_in_cam(cameras, images, o), max_error_rad, point)
    })
}

/// [`filter_point_pixel`] on every point.
pub fn filter_pixel(reconstruction: &mut Reconstruction, max_error_px: f64) -> Removed {
    filter_all(reconstruction, |cameras, images, point| filter_point_pixel(cameras, images, max_error_px, point))
}

/// [`filter_point_triangulation_angle`] on every point.
pub fn filter_triangulation_angle(reconstruction: &mut Reconstruction, min_angle_rad: f64) -> Removed {
    let centers: Vec<DVec3> = reconstruction.images.iter().map(|i| i.cam_from_world.center()).collect();
    filter_all(reconstruction, |_, _, point| filter_point_triangulation_angle(&centers, min_angle_rad, point))
}

fn ray_in_cam(cameras: &[Camera], images: &[Image], o: Observation) -> Option<DVec3> {
    let image = &images[o.image as usize];
    cameras[image.camera].ray_from_pixel(image.keypoints_px[o.keypoint as usize])
}

fn filter_all(
    reconstruction: &mut Reconstruction,
    mut filter: impl FnMut(&[Camera], &[Image], &mut Point) -> Removed,
) -> Removed {
    let Reconstruction { cameras, images, points, .. } = reconstruction;
    let removed = points.iter_mut().map(|point| filter(cameras, images, point)).sum();
    points.retain(|point| !point.observations.is_empty());
    removed
}

#[cfg(test)]
mod tests {
    use epipole_geometry::camera::CameraModel;
    use glam::DVec2;

    use super::*;
    use crate::fixture::{row_of_cameras, shift_keypoint};

    type Filter = fn(&mut Reconstruction, f64) -> Removed;

    /// Every filter that drops single observations, with a limit between the errors of shifts by 5 and by 20 pixels.
    const BY_OBSERVATION: [(Filter, f64); 3] =
        [(filter_pixel, 10.0), (filter_normalized, 10.0 / 1200.0), (filter_angular, 8.0 / 1200.0)];

    #[test]
    fn single_observations_go_and_points_with_two_good_ones_stay() {
        for (filter, limit) in BY_OBSERVATION {
            let mut r = row_of_cameras(4, 6);
            assert_eq!(filter(&mut r, limit), Removed::default());
            shift_keypoint(&mut r, 0, 2, DVec2::new(5.0, 0.0));
            assert_eq!(filter(&mut r, limit), Removed::default());
            shift_keypoint(&mut r, 0, 2, DVec2::new(15.0, 0.0));
            shift_keypoint(&mut r, 3, 2, DVec2::new(0.0, 20.0));
            assert_eq!(filter(&mut r, limit), Removed { observations: 2, points: 0 });
            let seen_by: Vec<u32> = r.points[2].observations.iter().map(|o| o.image).collect();
            assert_eq!(seen_by, [1, 2]);
            assert_eq!(r.num_observations(), 22);
        }
    }

    #[test]
    fn a_point_with_one_good_observation_goes_and_all_its_observations_count() {
        for (filter, limit) in BY_OBSERVATION {
            let mut r = row_of_cameras(3, 4);
            for image in 0..2 {
                shift_keypoint(&mut r, image, 1, DVec2::new(0.0, 20.0));
            }
            assert_eq!(filter(&mut r, limit), Removed { observations: 3, points: 1 });
            let ids: Vec<u64> = r.points.iter().map(|p| p.id).collect();
            assert_eq!(ids, [1, 3, 4], "order and ids of the others stay");
        }
    }

    #[test]
    fn points_behind_and_broken_points_go() {
        for (filter, limit) in BY_OBSERVATION {
            let mut r = row_of_cameras(3, 2);
            r.points[0].position.z = -5.0;
            r.points[1].position.x = f64::NAN;
            assert_eq!(filter(&mut r, limit), Removed { observations: 6, points: 2 });
            assert!(r.points.is_empty());
        }
    }

    #[test]
    fn far_points_have_no_angle() {
        let mut r = row_of_cameras(3, 2);
        // Two units of baseline: 1° at a distance of 114.
        r.points[0].position = DVec3::new(1.0, 0.0, 116.0);
        r.points[1].position = DVec3::new(1.0, 0.0, 113.0);
        assert_eq!(filter_triangulation_angle(&mut r, 1f64.to_radians()), Removed { observations: 3, points: 1 });
        assert_eq!(r.points[0].id, 2);
    }

    #[test]
    fn errors_have_their_definitions() {
        let ray = DVec3::Z;
        assert!((normalized_error(CameraFamily::Perspective, DVec3::new(0.2, 0.0, 2.0), ray) - 0.1).abs() < 1e-15);
        assert_eq!(normalized_error(CameraFamily::Perspective, DVec3::new(0.2, 0.0, 1e-13), ray), f64::INFINITY);
        assert!((normalized_error(CameraFamily::Spherical, DVec3::new(-2.0, 0.2, 0.0), -DVec3::X) - 0.1).abs() < 1e-15);
        assert!((angular_error_rad(DVec3::new(1.0, 0.0, 1.0), ray) - std::f64::consts::FRAC_PI_4).abs() < 1e-15);
        assert_eq!(angular_error_rad(DVec3::ZERO, ray), std::f64::consts::PI);
        assert_eq!(angular_error_rad(-DVec3::Z, ray), std::f64::consts::PI);
    }

    #[test]
    fn spherical_cameras_keep_what_is_behind_them() {
        let mut r = row_of_cameras(2, 1);
        r.cameras[0] = Camera::with_default_params(1, CameraModel::Equirectangular, 1000, 500);
        let position = DVec3::new(0.4, 0.3, -5.0);
        for image in &mut r.images {
            let in_cam = image.cam_from_world.transform_point(position);
            image.keypoints_px = vec![r.cameras[0].project(in_cam).expect("everywhere")].into();
        }
        r.points[0].position = position;
        for (filter, limit) in BY_OBSERVATION {
            assert_eq!(filter(&mut r, limit), Removed::default());
        }
    }
}
