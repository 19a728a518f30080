//! Nonlinear refinement of a relative pose: the robust sum of squared tangent Sampson errors, in pixels.
//!
//! Five degrees of freedom: a rotation and a unit baseline. Levenberg–Marquardt on the signed error
//! `r = C / √D` with `C = r₂ᵀ E r₁` and D the squared norm of its derivative by the four pixel coordinates.

use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

use super::correspondence::{Bearing, BearingPair};
use super::decompose::{cross_matrix, essential_from_pose};
use super::sampson::tangent_sampson_squared;
use crate::Rigid3;
use crate::camera::Camera;

/// How errors count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SampsonLoss {
    /// ½ c² ln(1 + r²/c²), c in px.
    Cauchy(f64),
    /// ½ min(r², c²), c in px.
    Truncated(f64),
}

impl SampsonLoss {
    #[inline(always)]
    fn cost_and_weight(self, squared: f64) -> (f64, f64) {
        match self {
            Self::Cauchy(c) => {
                let ratio = squared / (c * c);
                (0.5 * c * c * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
            Self::Truncated(c) if squared < c * c => (0.5 * squared, 1.0),
            Self::Truncated(c) => (0.5 * c * c, 0.0),
        }
    }
}

/// How long and how robustly to refine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineOptions {
    /// Most accepted and rejected steps together.
    pub max_iterations: usize,
    /// The loss.
    pub loss: SampsonLoss,
}

impl Default for RefineOptions {
    /// Cauchy with 1 px, the usual noise of a keypoint.
    fn default() -> Self {
        Self { max_iterations: 20, loss: SampsonLoss::Cauchy(1.0) }
    }
}

/// The outcome of a refinement.
#[derive(Clone, Copy, Debug)]
pub struct RefinedPose {
    /// The motion, with a unit baseline.
    pub cam2_from_cam1: Rigid3,
    /// Robust cost at the start, px².
    pub initial_cost: f64,
    /// Robust cost at the end, px².
    pub final_cost: f64,
}

/// Refines `start` over matched pixels (`points1[i]` with `points2[i]`), all taken as inliers up to the loss.
///
/// Pixels without a ray are left out. `None` where fewer than five usable matches are left, where the lists differ in
/// length or where `start` is not finite or has no baseline.
pub fn refine_relative_pose(
    camera1: &Camera,
    points1: &[DVec2],
    camera2: &Camera,
    points2: &[DVec2],
    start: &Rigid3,
    options: &RefineOptions,
) -> Option<RefinedPose> {
    if points1.len() != points2.len() {
        return None;
    }
    let pairs: Vec<BearingPair> = points1
        .iter()
        .zip(points2)
        .filter_map(|(&p, &q)| {
            let (first, second) = (Bearing::from_pixel(camera1, p)?, Bearing::from_pixel(camera2, q)?);
            Some(BearingPair { first, second })
        })
        .collect();
    minimize(pairs.iter(), start, options)
}

/// The robust cost, Σ ρ, px².
pub(super) fn robust_cost<'a>(
    pairs: impl Iterator<Item = &'a BearingPair>,
    cam2_from_cam1: &Rigid3,
    loss: SampsonLoss,
) -> f64 {
    let essential = essential_from_pose(cam2_from_cam1);
    pairs
        .map(|pair| {
            let squared = tangent_sampson_squared(&essential, pair);
            // On both epipoles every pixel fits.
            loss.cost_and_weight(if squared.is_nan() { 0.0 } else { squared }).0
        })
        .sum()
}

/// First damping, relative to the diagonal: RANSAC's poses are good, so that Gauss–Newton nearly always holds.
const FIRST_DAMPING: f64 = 1e-3;
const SMALLEST_DAMPING: f64 = 1e-10;
const LARGEST_DAMPING: f64 = 1e6;

/// Relative decrease of the cost below which more steps do not move the pose visibly.
const COST_TOLERANCE: f64 = 1e-7;

pub(super) fn minimize<'a>(
    pairs: impl Iterator<Item = &'a BearingPair> + Clone,
    start: &Rigid3,
    options: &RefineOptions,
) -> Option<RefinedPose> {
    let length = start.translation.length();
    let mut pose = Rigid3::new(start.rotation, start.translation / length);
    if !pose.is_finite() || pairs.clone().take(5).count() < 5 {
        return None;
    }
    let mut cost = robust_cost(pairs.clone(), &pose, options.loss);
    let initial_cost = cost;
    let mut damping = FIRST_DAMPING;
    let mut system = linearize(pairs.clone(), &pose, options.loss);
    for _ in 0..options.max_iterations {
        let mut damped = system.hessian;
        for i in 0..5 {
            damped[(i, i)] += damping * damped[(i, i)].max(1e-12 * system.hessian.diagonal().max());
        }
        let candidate = damped.cholesky().map(|c| system.step(&pose, &c.solve(&-system.gradient)));
        let accepted = candidate.filter(Rigid3::is_finite).and_then(|candidate| {
            let new_cost = robust_cost(pairs.clone(), &candidate, options.loss);
            (new_cost < cost).then_some((candidate, new_cost))
        });
        let Some((candidate, new_cost)) = accepted else {
            damping *= 10.0;
            if damping > LARGEST_DAMPING {
                break;
            }
            continue;
        };
        let decrease = cost - new_cost;
        (pose, cost) = (candidate, new_cost);
        damping = (damping * 0.1).max(SMALLEST_DAMPING);
        if decrease <= COST_TOLERANCE * cost {
            break;
        }
        system = linearize(pairs.clone(), &pose, options.loss);
    }
    Some(RefinedPose { cam2_from_cam1: pose, initial_cost, final_cost: cost })
}

struct NormalEquations {
    hessian: SMatrix<f64, 5, 5>,
    gradient: SVector<f64, 5>,
    /// Two directions across the baseline.
    across: [DVec3; 2],
}

impl NormalEquations {
    fn step(&self, pose: &Rigid3, d: &SVector<f64, 5>) -> Rigid3 {
        let rotation = DQuat::from_scaled_axis(DVec3::new(d[0], d[1], d[2])) * pose.rotation;
        let translation = pose.translation + self.across[0] * d[3] + self.across[1] * d[4];
        Rigid3::new(rotation, translation.normalize())
    }
}

fn linearize<'a>(pairs: impl Iterator<Item = &'a BearingPair>, pose: &Rigid3, loss: SampsonLoss) -> NormalEquations {
    let (rotation, t) = (pose.rotation_matrix(), pose.translation);
    let essential = cross_matrix(t) * rotation;
    let (across_a, across_b) = t.any_orthonormal_pair();
    let mut upper = [[0.0; 5]; 5];
    let mut gradient = [0.0; 5];
    for pair in pairs {
        let Some((residual, row)) = residual_row(pair, &essential, &rotation, t, across_a, across_b) else { continue };
        let weight = loss.cost_and_weight(residual * residual).1;
        if weight == 0.0 {
            continue;
        }
        for i in 0..5 {
            let weighted = weight * row[i];
            gradient[i] += weighted * residual;
            for j in i..5 {
                upper[i][j] += weighted * row[j];
            }
        }
    }
    NormalEquations {
        hessian: SMatrix::from_fn(|i, j| upper[i.min(j)][i.max(j)]),
        gradient: SVector::from(gradient),
        across: [across_a, across_b],
    }
}

/// The signed error and its derivative by a left rotation increment and a move across the baseline.
#[inline]
fn residual_row(
    pair: &BearingPair,
    essential: &DMat3,
    rotation: &DMat3,
    t: DVec3,
    across_a: DVec3,
    across_b: DVec3,
) -> Option<(f64, [f64; 5])> {
    let (ray1, ray2) = (pair.first.ray, pair.second.ray);
    let line2 = *essential * ray1;
    let line1 = essential.transpose() * ray2;
    let ([u1, v1], [u2, v2]) = (pair.first.by_pixel, pair.second.by_pixel);
    let (a, b, c, d) = (u1.dot(line1), v1.dot(line1), u2.dot(line2), v2.dot(line2));
    let squared = a * a + b * b + c * c + d * d;
    let value = ray2.dot(line2);
    let inverse = 1.0 / squared.sqrt();
    let ratio = value / squared;
    if !ratio.is_finite() || !inverse.is_finite() {
        return None;
    }
    // dr/dE = (r₂ (r₁ − k J₁a)ᵀ − k (J₂b) r₁ᵀ)/√D with k = C/D: two outer products x yᵀ. Each gives
    // xᵀ [t]× dR y = ω · (Ry × (x × t)) and xᵀ [dt]× R y = dt · (Ry × x).
    let y1 = *rotation * (ray1 - (u1 * a + v1 * b) * ratio);
    let x2 = (u2 * c + v2 * d) * -ratio;
    let y2 = *rotation * ray1;
    let by_rotation = (y1.cross(ray2.cross(t)) + y2.cross(x2.cross(t))) * inverse;
    let by_translation = (y1.cross(ray2) + y2.cross(x2)) * inverse;
    let row = [by_rotation.x, by_rotation.y, by_rotation.z, by_translation.dot(across_a), by_translation.dot(across_b)];
    Some((value * inverse, row))
}
