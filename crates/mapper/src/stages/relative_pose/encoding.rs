//! Problems and what was found as plain numbers, one after the other: what workers can send one another. Both ends are of one
//! build, so there is no version; a `f64` holds every count and index exactly.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_geometry::two_view::{PoseSource, TwoViewConfig, TwoViewGeometry};
use glam::{DMat3, DQuat, DVec2, DVec3};

use super::problem::{Found, Problem, Task};

/// Solves problems for [`super::PairPool`]: those of a batch in order, and what was found in the same order. `None` where the
/// numbers are no batch of this build.
pub fn solve_pairs(problems: &[f64]) -> Option<Vec<f64>> {
    let mut numbers = Numbers(problems);
    let mut answers = Vec::new();
    while !numbers.0.is_empty() {
        Problem::read(&mut numbers)?.solve().write(&mut answers);
    }
    Some(answers)
}

/// What was found for so many problems.
pub(super) fn answers(numbers: &[f64], count: usize) -> Option<Vec<Found>> {
    let mut numbers = Numbers(numbers);
    let mut found = Vec::new();
    for _ in 0..count {
        found.push(Found::read(&mut numbers)?);
    }
    numbers.0.is_empty().then_some(found)
}

impl Problem {
    pub(super) fn write(&self, out: &mut Vec<f64>) {
        match self.task {
            Task::Verified(config) => out.push(f64::from(config as i32)),
            Task::Raw { min_inliers } => out.extend([-1.0, min_inliers as f64]),
        }
        self.matrices.iter().for_each(|matrix| write_matrix(matrix, out));
        for camera in &self.cameras {
            out.extend([f64::from(camera.id), f64::from(camera.model.id())]);
            out.extend([camera.width_px as f64, camera.height_px as f64, f64::from(camera.has_prior_focal)]);
            out.push(camera.params.len() as f64);
            out.extend(&camera.params);
        }
        // As two numbers: a seed may have more digits than a number keeps.
        out.extend([self.max_error_px, self.enough, (self.seed >> 32) as f64, f64::from(self.seed as u32)]);
        out.push(self.points_px[0].len() as f64);
        out.extend(self.points_px.iter().flatten().flat_map(|point| point.to_array()));
    }

    pub(super) fn read(numbers: &mut Numbers) -> Option<Self> {
        let task = match numbers.next()? {
            -1.0 => Task::Raw { min_inliers: numbers.next()? as usize },
            config => Task::Verified(TwoViewConfig::from_id(config as i64)?),
        };
        let matrices = [read_matrix(numbers)?, read_matrix(numbers)?, read_matrix(numbers)?];
        let cameras = [read_camera(numbers)?, read_camera(numbers)?];
        let [max_error_px, enough, high, low, count] = numbers.array()?;
        let mut points =
            || numbers.take((2.0 * count) as usize).map(|list| list.chunks_exact(2).map(DVec2::from_slice).collect());
        let points_px = [points()?, points()?];
        Some(Self {
            task,
            matrices,
            cameras,
            points_px,
            max_error_px,
            enough,
            seed: ((high as u64) << 32) | low as u64,
        })
    }
}

impl Found {
    pub(super) fn write(&self, out: &mut Vec<f64>) {
        match self {
            Self::Stored => out.push(0.0),
            Self::Weak => out.push(1.0),
            Self::WithoutPose => out.push(2.0),
            Self::Pose(pose, source) => {
                out.push(if *source == PoseSource::Stored { 3.0 } else { 4.0 });
                write_pose(pose, out);
            }
            Self::Verified(geometry) => {
                out.extend([5.0, f64::from(geometry.config as i32), geometry.tri_angle_rad]);
                for matrix in [&geometry.essential, &geometry.fundamental, &geometry.homography] {
                    write_matrix(matrix, out);
                }
                out.push(f64::from(geometry.cam2_from_cam1.is_some()));
                geometry.cam2_from_cam1.iter().for_each(|pose| write_pose(pose, out));
                out.push(geometry.inliers.len() as f64);
                out.extend(geometry.inliers.iter().map(|&k| f64::from(k)));
            }
        }
    }

    fn read(numbers: &mut Numbers) -> Option<Self> {
        Some(match numbers.next()? {
            0.0 => Self::Stored,
            1.0 => Self::Weak,
            2.0 => Self::WithoutPose,
            3.0 => Self::Pose(read_pose(numbers)?, PoseSource::Stored),
            4.0 => Self::Pose(read_pose(numbers)?, PoseSource::Estimated),
            5.0 => {
                let [config, tri_angle_rad] = numbers.array()?;
                Self::Verified(Box::new(TwoViewGeometry {
                    config: TwoViewConfig::from_id(config as i64)?,
                    tri_angle_rad,
                    essential: read_matrix(numbers)?,
                    fundamental: read_matrix(numbers)?,
                    homography: read_matrix(numbers)?,
                    cam2_from_cam1: if numbers.next()? == 0.0 { None } else { Some(read_pose(numbers)?) },
                    inliers: numbers.list()?.iter().map(|&k| k as u32).collect(),
                }))
            }
            _ => return None,
        })
    }
}

/// What is left to read.
pub(super) struct Numbers<'a>(pub(super) &'a [f64]);

impl<'a> Numbers<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [f64]> {
        let (taken, left) = self.0.split_at_checked(count)?;
        self.0 = left;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[f64; N]> {
        self.take(N)?.try_into().ok()
    }

    fn next(&mut self) -> Option<f64> {
        self.array().map(|[number]| number)
    }

    /// A list after its length.
    fn list(&mut self) -> Option<&'a [f64]> {
        let count = self.next()?;
        self.take(count as usize)
    }
}

fn read_camera(numbers: &mut Numbers) -> Option<Camera> {
    let [id, model, width, height, prior] = numbers.array()?;
    Some(Camera {
        id: id as u32,
        model: CameraModel::from_id(model as i32)?,
        width_px: width as u64,
        height_px: height as u64,
        params: numbers.list()?.to_vec(),
        has_prior_focal: prior != 0.0,
    })
}

fn write_matrix(matrix: &Option<DMat3>, out: &mut Vec<f64>) {
    out.push(f64::from(matrix.is_some()));
    out.extend(matrix.iter().flat_map(|matrix| matrix.to_cols_array()));
}

/// The outer `None` is for numbers that are missing.
fn read_matrix(numbers: &mut Numbers) -> Option<Option<DMat3>> {
    Some(if numbers.next()? == 0.0 { None } else { Some(DMat3::from_cols_array(&numbers.array()?)) })
}

fn write_pose(pose: &Rigid3, out: &mut Vec<f64>) {
    out.extend(pose.rotation.to_array());
    out.extend(pose.translation.to_array());
}

fn read_pose(numbers: &mut Numbers) -> Option<Rigid3> {
    let [x, y, z, w, tx, ty, tz] = numbers.array()?;
    // Not by `Rigid3::new`, which would normalise again.
    Some(Rigid3 { rotation: DQuat::from_xyzw(x, y, z, w), translation: DVec3::new(tx, ty, tz) })
}
