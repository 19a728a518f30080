//! The pose of one pair as a problem by itself: whoever solves it, here or in another worker, finds the same.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use epipole_geometry::two_view::{
    PoseSource, RansacOptions, RelativePoseOptions, TwoViewConfig, TwoViewGeometry, TwoViewOptions, estimate_two_view,
    relative_pose_from_geometry,
};
use glam::{DMat3, DVec2};

/// Everything that the relative pose of a pair follows from.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Problem {
    pub(super) task: Task,
    /// Essential matrix, fundamental matrix and homography, as far as the database has them and they are believed.
    pub(super) matrices: [Option<DMat3>; 3],
    pub(super) cameras: [Camera; 2],
    /// Matched pixels, as many in the second image as in the first.
    pub(super) points_px: [Vec<DVec2>; 2],
    /// Largest tangent Sampson error of an inlier, px.
    pub(super) max_error_px: f64,
    /// Fewest matches that must agree with the pose.
    pub(super) enough: f64,
    pub(super) seed: u64,
}

/// What to make of the matches.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Task {
    /// They were verified, with this label.
    Verified(TwoViewConfig),
    /// They are raw, and degenerate where fewer agree.
    Raw { min_inliers: usize },
}

/// What was found for a pair; the last two drop it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Found {
    Stored,
    Pose(Rigid3, PoseSource),
    /// Its inliers are places in the problem's lists of pixels.
    Verified(Box<TwoViewGeometry>),
    Weak,
    WithoutPose,
}

impl Problem {
    pub(super) fn solve(&self) -> Found {
        let [camera1, camera2] = &self.cameras;
        let [points1, points2] = &self.points_px;
        let ransac = RansacOptions { max_error_px: self.max_error_px, ..RansacOptions::default() };
        let relative_pose = RelativePoseOptions { ransac, ..RelativePoseOptions::default() };
        let agree = |pose: &Rigid3, inliers: &[u32]| pose.is_finite() && inliers.len() as f64 >= self.enough;
        match self.task {
            Task::Verified(config) => {
                let [e, f, h] = self.matrices.each_ref().map(Option::as_ref);
                let pose = relative_pose_from_geometry(
                    config,
                    e,
                    f,
                    h,
                    camera1,
                    points1,
                    camera2,
                    points2,
                    &relative_pose,
                    self.seed,
                );
                match pose {
                    Some(p) if agree(&p.cam2_from_cam1, &p.inliers) => Found::Pose(p.cam2_from_cam1, p.source),
                    _ => Found::WithoutPose,
                }
            }
            Task::Raw { min_inliers } => {
                let options =
                    TwoViewOptions { relative_pose, min_num_inliers: min_inliers, ..TwoViewOptions::default() };
                let matches: Vec<[u32; 2]> = (0..points1.len() as u32).map(|k| [k, k]).collect();
                let geometry = estimate_two_view(camera1, points1, camera2, points2, &matches, &options, self.seed);
                if !geometry.config.has_pose() {
                    return Found::Weak;
                }
                match geometry.cam2_from_cam1 {
                    Some(pose) if agree(&pose, &geometry.inliers) => Found::Verified(Box::new(geometry)),
                    _ => Found::WithoutPose,
                }
            }
        }
    }
}
