//! The relative pose of two calibrated cameras: estimated from matches, or from the matrices that a database stores.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::cheirality::{is_in_front_or_far, median_parallax_rad};
use super::config::TwoViewConfig;
use super::correspondence::{Bearing, BearingPair};
use super::decompose::{decompose_essential, decompose_homography, essential_from_pose};
use super::estimators::{EssentialEstimator, most_in_front};
use super::panorama::{rotation_if_panoramic, transfer_squared};
use super::ransac::{RansacOptions, ransac, shuffled};
use super::refine_relative_pose::{RefineOptions, SampsonLoss, minimize, robust_cost};
use super::sampson::tangent_sampson_squared;
use crate::Rigid3;
use crate::camera::Camera;

/// How relative poses are estimated and refined.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct RelativePoseOptions {
    /// Sampling, and the largest error of an inlier (tangent Sampson, px).
    pub ransac: RansacOptions,
    /// The final refinement.
    pub refine: RefineOptions,
}

/// Where a pose comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseSource {
    /// Decomposed from a stored matrix, then refined.
    Stored,
    /// Estimated from the matches: no usable matrix was stored.
    Estimated,
}

/// The relative pose of a pair and what agrees with it.
#[derive(Clone, Debug)]
pub struct RelativePose {
    /// The motion; the baseline is 1, or 0 for a pure rotation.
    pub cam2_from_cam1: Rigid3,
    /// Indices of the matches that agree with it in error and depth signs, ascending.
    pub inliers: Vec<u32>,
    /// Median angle under which the inliers are seen, min(θ, π − θ), rad.
    pub tri_angle_rad: f64,
    /// Where the pose comes from.
    pub source: PoseSource,
}

/// A stored matrix is not trusted where less than this share of its matches agrees with its pose: the calibration
/// changed, or the writer followed another convention.
const MIN_AGREEING_RATIO: f64 = 0.5;

/// Estimates the relative pose from matched pixels (`points1[i]` with `points2[i]`) by the five-point algorithm.
///
/// Deterministic for a seed. `None` where a camera is not valid, where fewer than five matches have rays, or where no
/// five of them fix a pose (all the same point). Extra points of the longer list are ignored.
pub fn estimate_relative_pose(
    camera1: &Camera,
    points1: &[DVec2],
    camera2: &Camera,
    points2: &[DVec2],
    options: &RelativePoseOptions,
    seed: u64,
) -> Option<RelativePose> {
    let view = CalibratedPair::new(camera1, points1, camera2, points2, seed)?;
    view.estimate(options, seed)
}

/// The relative pose that the stored matrices of a verified pair imply, refined on its inlier matches (`points1[i]`
/// with `points2[i]`, px) with the present calibration.
///
/// CALIBRATED pairs use `essential`, or `K2ᵀ F K1`; UNCALIBRATED ones `K2ᵀ F K1`; planar and panoramic ones the
/// homography `K2⁻¹ H K1` between rays. Where none of the wanted matrices is stored (databases of 2017), or where less
/// than half of the matches agree with their pose, the pose is estimated from the matches and its source says so.
/// `None` for the other configurations, and where [`estimate_relative_pose`] gives none.
pub fn relative_pose_from_geometry(
    config: TwoViewConfig,
    essential: Option<&DMat3>,
    fundamental: Option<&DMat3>,
    homography: Option<&DMat3>,
    camera1: &Camera,
    points1: &[DVec2],
    camera2: &Camera,
    points2: &[DVec2],
    options: &RelativePoseOptions,
    seed: u64,
) -> Option<RelativePose> {
    if !config.has_pose() {
        return None;
    }
    let view = CalibratedPair::new(camera1, points1, camera2, points2, seed)?;
    let (k1, k2) = (calibration_matrix(camera1), calibration_matrix(camera2));
    let from_fundamental = || fundamental.map(|f| k2.transpose() * *f * k1);
    let epipolar = if config == TwoViewConfig::Uncalibrated {
        from_fundamental().or(essential.copied())
    } else {
        essential.copied().or_else(from_fundamental)
    };
    let everything: Vec<usize> = (0..view.pairs.len()).collect();
    let pose = match (config.is_planar_or_panoramic(), homography) {
        (true, Some(h)) => {
            view.pose_from_homography(&(k2.inverse() * *h * k1), epipolar.as_ref(), &everything, options)
        }
        _ => epipolar.and_then(|e| view.pose_from_essential(&e, &everything, options)),
    };
    if let Some(pose) = pose {
        let stored = view.finish(pose, PoseSource::Stored, options);
        if stored.inliers.len() as f64 >= MIN_AGREEING_RATIO * view.pairs.len() as f64 {
            return Some(stored);
        }
    }
    view.estimate(options, seed)
}

/// The matrix that maps `(x/z, y/z, 1)` to the pixel of a camera without its distortion.
pub fn calibration_matrix(camera: &Camera) -> DMat3 {
    let focal = camera.model.focal_params();
    let mean = camera.mean_focal_px();
    let (fx, fy) = match *focal {
        [x, y] => (camera.params[x], camera.params[y]),
        _ => (mean, mean),
    };
    let center = camera.principal_point_px();
    DMat3::from_cols(DVec3::new(fx, 0.0, 0.0), DVec3::new(0.0, fy, 0.0), center.extend(1.0))
}

/// Matches of two calibrated cameras as bearings, in random order.
pub(super) struct CalibratedPair {
    pub(super) pairs: Vec<BearingPair>,
    /// Which match each pair is.
    pub(super) matches: Vec<usize>,
    /// Sum of the angles of one pixel in the two images, rad.
    pixel_rad: f64,
}

impl CalibratedPair {
    pub(super) fn new(
        camera1: &Camera,
        points1: &[DVec2],
        camera2: &Camera,
        points2: &[DVec2],
        seed: u64,
    ) -> Option<Self> {
        camera1.validate().ok()?;
        camera2.validate().ok()?;
        let len = points1.len().min(points2.len());
        let mut pairs = Vec::with_capacity(len);
        let mut matches = Vec::with_capacity(len);
        for i in shuffled(len, seed) {
            let first = Bearing::from_pixel(camera1, points1[i]);
            if let Some((first, second)) = first.zip(Bearing::from_pixel(camera2, points2[i])) {
                pairs.push(BearingPair { first, second });
                matches.push(i);
            }
        }
        let pixel_rad = 1.0 / camera1.mean_focal_px() + 1.0 / camera2.mean_focal_px();
        Some(Self { pairs, matches, pixel_rad })
    }

    fn estimate(&self, options: &RelativePoseOptions, seed: u64) -> Option<RelativePose> {
        let estimator = EssentialEstimator::new(&self.pairs, options.ransac.max_error_px);
        let report = ransac(&estimator, &options.ransac, None, seed)?;
        let pose = self.pose_from_essential(&report.model, &report.inliers, options)?;
        Some(self.finish(pose, PoseSource::Estimated, options))
    }

    /// Decomposes, picks by depth signs and refines on the chosen pairs.
    pub(super) fn pose_from_essential(
        &self,
        essential: &DMat3,
        chosen: &[usize],
        options: &RelativePoseOptions,
    ) -> Option<Rigid3> {
        let pose = most_in_front(&decompose_essential(essential)?, || chosen.iter().map(|&i| &self.pairs[i]))?;
        Some(self.settled(self.best_refined(&[pose], chosen, options)?, options))
    }

    /// Refines once more on the pairs that agree with the pose itself: the first set was that of a rougher model.
    fn settled(&self, pose: Rigid3, options: &RelativePoseOptions) -> Rigid3 {
        let agreeing = self.agreeing(&pose, options);
        let again = minimize(agreeing.iter().map(|&i| &self.pairs[i]), &pose, &options.refine);
        again.map_or(pose, |refined| refined.cam2_from_cam1)
    }

    /// The motion of a homography between rays: a pure rotation where one explains the pairs as well, else the plane
    /// motion (or the motion of `essential`, if given) with the smallest error over the chosen pairs.
    pub(super) fn pose_from_homography(
        &self,
        homography: &DMat3,
        essential: Option<&DMat3>,
        chosen: &[usize],
        options: &RelativePoseOptions,
    ) -> Option<Rigid3> {
        let oriented = if homography.determinant() < 0.0 { *homography * -1.0 } else { *homography };
        let max_squared = options.ransac.max_error_px.powi(2);
        let explained: Vec<&BearingPair> = chosen
            .iter()
            .map(|&i| &self.pairs[i])
            .filter(|pair| transfer_squared(&oriented, pair) <= max_squared)
            .collect();
        let without_baseline = |rotation: DQuat| Rigid3::new(rotation, DVec3::ZERO);
        if let Some(rotation) = rotation_if_panoramic(&explained, &oriented) {
            return Some(without_baseline(rotation));
        }
        let motions = decompose_homography(homography);
        let mut poses: Vec<Rigid3> = Vec::with_capacity(5);
        poses.extend(
            essential
                .and_then(decompose_essential)
                .and_then(|four| most_in_front(&four, || chosen.iter().map(|&i| &self.pairs[i]))),
        );
        poses.extend(motions.iter().map(|m| m.cam2_from_cam1).filter(|pose| pose.translation != DVec3::ZERO));
        let rotation = motions.first().map(|m| m.cam2_from_cam1.rotation);
        let refined = self.best_refined(&poses, chosen, options).map(|pose| self.settled(pose, options));
        refined.or(rotation.map(without_baseline))
    }

    /// Refines each pose on the chosen pairs; the one with the smallest cost, where pairs behind a camera cost as much
    /// as outliers. The first of equals.
    fn best_refined(&self, poses: &[Rigid3], chosen: &[usize], options: &RelativePoseOptions) -> Option<Rigid3> {
        let pairs = || chosen.iter().map(|&i| &self.pairs[i]);
        let loss = SampsonLoss::Truncated(options.ransac.max_error_px);
        let behind_cost = 0.5 * options.ransac.max_error_px.powi(2);
        let mut best: Option<(f64, Rigid3)> = None;
        for pose in poses {
            let Some(refined) = minimize(pairs(), pose, &options.refine) else { continue };
            let pose = refined.cam2_from_cam1;
            let (front, behind): (Vec<_>, Vec<_>) = pairs().partition(|p| self.is_in_front(&pose, p, options));
            if front.is_empty() {
                continue;
            }
            let cost = robust_cost(front.into_iter(), &pose, loss) + behind_cost * behind.len() as f64;
            // Two poses of a plane fit equally well without noise; a strict order keeps the first.
            if best.is_none_or(|(least, _)| cost < least * (1.0 - 1e-6) - 1e-9) {
                best = Some((cost, pose));
            }
        }
        best.map(|(_, pose)| pose)
    }

    fn is_in_front(&self, pose: &Rigid3, pair: &BearingPair, options: &RelativePoseOptions) -> bool {
        is_in_front_or_far(pose, pair.first.ray, pair.second.ray, options.ransac.max_error_px * self.pixel_rad)
    }

    /// The pairs that agree with a pose, as positions in `pairs`.
    pub(super) fn agreeing(&self, pose: &Rigid3, options: &RelativePoseOptions) -> Vec<usize> {
        let max_squared = options.ransac.max_error_px.powi(2);
        if pose.translation == DVec3::ZERO {
            let rotation = pose.rotation_matrix();
            return (0..self.pairs.len())
                .filter(|&i| transfer_squared(&rotation, &self.pairs[i]) <= max_squared)
                .collect();
        }
        let essential = essential_from_pose(pose);
        (0..self.pairs.len())
            .filter(|&i| {
                let pair = &self.pairs[i];
                tangent_sampson_squared(&essential, pair) <= max_squared && self.is_in_front(pose, pair, options)
            })
            .collect()
    }

    pub(super) fn median_parallax_rad(&self, rotation: DQuat, chosen: &[usize]) -> f64 {
        median_parallax_rad(rotation, chosen.iter().map(|&i| (self.pairs[i].first.ray, self.pairs[i].second.ray)))
    }

    pub(super) fn finish(&self, pose: Rigid3, source: PoseSource, options: &RelativePoseOptions) -> RelativePose {
        let agreeing = self.agreeing(&pose, options);
        let tri_angle_rad = self.median_parallax_rad(pose.rotation, &agreeing);
        let mut inliers: Vec<u32> = agreeing.iter().map(|&i| self.matches[i] as u32).collect();
        inliers.sort_unstable();
        RelativePose { cam2_from_cam1: pose, inliers, tri_angle_rad, source }
    }
}
