//! The three models as RANSAC sees them: essential matrix, fundamental matrix, homography.

use glam::{DMat3, DVec2, DVec3};

use super::cheirality::in_front_after_rotation;
use super::correspondence::{BearingPair, Blocks, LANES};
use super::decompose::{decompose_essential, essential_from_pose};
use super::eight_point::eight_point_fundamental;
use super::five_point::five_point;
use super::homography::{homography_four_point, homography_least_squares};
use super::ransac::Estimator;
use super::refine_relative_pose::{RefineOptions, SampsonLoss, minimize};
use super::sampson::{epipolar_vectors, sampson_block, tangent_sampson_block, transfer_block, transfer_vectors};
use super::seven_point::seven_point;
use crate::Rigid3;

/// Inliers used by a fit inside RANSAC. More only cost time: the final fit uses all. Data are in random order, so the
/// first ones are a fair sample.
const LOCAL_FIT_INLIERS: usize = 256;

/// Steps of a nonlinear fit inside RANSAC; the next fit goes on where it stopped.
const LOCAL_FIT_ITERATIONS: usize = 5;

fn thinned(inliers: &[usize]) -> &[usize] {
    &inliers[..inliers.len().min(LOCAL_FIT_INLIERS)]
}

/// Essential matrix: five-point samples, tangent Sampson error, nonlinear local fits.
pub(super) struct EssentialEstimator<'a> {
    pairs: &'a [BearingPair],
    blocks: Blocks<6>,
    max_error_px: f64,
}

impl<'a> EssentialEstimator<'a> {
    pub(super) fn new(pairs: &'a [BearingPair], max_error_px: f64) -> Self {
        Self { pairs, blocks: Blocks::new(pairs.iter().map(epipolar_vectors)), max_error_px }
    }
}

impl Estimator for EssentialEstimator<'_> {
    type Model = DMat3;
    const MIN_SAMPLE: usize = 5;

    fn len(&self) -> usize {
        self.blocks.len()
    }

    fn estimate(&self, sample: &[usize], models: &mut Vec<DMat3>) {
        let rays1 = std::array::from_fn(|i| self.pairs[sample[i]].first.ray);
        let rays2 = std::array::from_fn(|i| self.pairs[sample[i]].second.ray);
        five_point(&rays1, &rays2, models);
    }

    fn refine(&self, start: &DMat3, inliers: &[usize]) -> Option<DMat3> {
        let chosen = thinned(inliers);
        let pose = most_in_front(&decompose_essential(start)?, || chosen.iter().map(|&i| &self.pairs[i]))?;
        let options =
            RefineOptions { max_iterations: LOCAL_FIT_ITERATIONS, loss: SampsonLoss::Truncated(self.max_error_px) };
        let refined = minimize(chosen.iter().map(|&i| &self.pairs[i]), &pose, &options)?;
        Some(essential_from_pose(&refined.cam2_from_cam1))
    }

    fn residuals_squared(&self, model: &DMat3, block: usize, out: &mut [f64; LANES]) {
        tangent_sampson_block(model, self.blocks.block(block), out);
    }
}

/// The pose with most pairs in front of both cameras; the first of equals. `None` where it has none.
pub(super) fn most_in_front<'a, I: Iterator<Item = &'a BearingPair>>(
    poses: &[Rigid3],
    pairs: impl Fn() -> I,
) -> Option<Rigid3> {
    let mut best = (0, None);
    for pose in poses {
        let rotation = pose.rotation_matrix();
        let in_front =
            |p: &&BearingPair| in_front_after_rotation(rotation * p.first.ray, p.second.ray, pose.translation);
        let count = pairs().filter(in_front).count();
        if count > best.0 {
            best = (count, Some(*pose));
        }
    }
    best.1
}

/// Fundamental matrix on points that are centred and of order one: seven-point samples, eight-point fits.
pub(super) struct FundamentalEstimator {
    points1: Vec<DVec2>,
    points2: Vec<DVec2>,
    blocks: Blocks<2>,
    unit_px: f64,
}

impl FundamentalEstimator {
    /// Points in units of `unit_px` pixels.
    pub(super) fn new(points1: Vec<DVec2>, points2: Vec<DVec2>, unit_px: f64) -> Self {
        let both = points1.iter().zip(&points2).map(|(p, q)| [p.extend(1.0), q.extend(1.0)]);
        let blocks = Blocks::new(both);
        Self { points1, points2, blocks, unit_px }
    }
}

impl Estimator for FundamentalEstimator {
    type Model = DMat3;
    const MIN_SAMPLE: usize = 7;

    fn len(&self) -> usize {
        self.blocks.len()
    }

    fn estimate(&self, sample: &[usize], models: &mut Vec<DMat3>) {
        let points1 = std::array::from_fn(|i| self.points1[sample[i]]);
        let points2 = std::array::from_fn(|i| self.points2[sample[i]]);
        seven_point(&points1, &points2, models);
    }

    fn refine(&self, _start: &DMat3, inliers: &[usize]) -> Option<DMat3> {
        let pick = |points: &[DVec2]| -> Vec<DVec2> { inliers.iter().map(|&i| points[i]).collect() };
        eight_point_fundamental(&pick(&self.points1), &pick(&self.points2))
    }

    fn residuals_squared(&self, model: &DMat3, block: usize, out: &mut [f64; LANES]) {
        sampson_block(model, self.blocks.block(block), out);
        for e in out {
            *e *= self.unit_px * self.unit_px;
        }
    }
}

/// Homography between rays: four-point samples, least-squares fits.
pub(super) struct HomographyEstimator<'a> {
    pairs: &'a [BearingPair],
    blocks: Blocks<4>,
}

impl<'a> HomographyEstimator<'a> {
    pub(super) fn new(pairs: &'a [BearingPair]) -> Self {
        Self { pairs, blocks: Blocks::new(pairs.iter().map(transfer_vectors)) }
    }
}

impl Estimator for HomographyEstimator<'_> {
    type Model = DMat3;
    const MIN_SAMPLE: usize = 4;

    fn len(&self) -> usize {
        self.blocks.len()
    }

    fn estimate(&self, sample: &[usize], models: &mut Vec<DMat3>) {
        let rays1 = std::array::from_fn(|i| self.pairs[sample[i]].first.ray);
        let rays2 = std::array::from_fn(|i| self.pairs[sample[i]].second.ray);
        models.extend(homography_four_point(&rays1, &rays2));
    }

    fn refine(&self, _start: &DMat3, inliers: &[usize]) -> Option<DMat3> {
        let pick =
            |side: fn(&BearingPair) -> DVec3| -> Vec<DVec3> { inliers.iter().map(|&i| side(&self.pairs[i])).collect() };
        let h = homography_least_squares(&pick(|p| p.first.ray), &pick(|p| p.second.ray))?;
        // The sign that keeps rays on their side.
        let along: f64 = inliers.iter().map(|&i| self.pairs[i].second.ray.dot(h * self.pairs[i].first.ray)).sum();
        Some(if along < 0.0 { h * -1.0 } else { h })
    }

    fn residuals_squared(&self, model: &DMat3, block: usize, out: &mut [f64; LANES]) {
        transfer_block(model, self.blocks.block(block), out);
    }
}
