//! Errors of camera centres and rotations after the best common motion.

use epipole_geometry::{Rigid3, Similarity3};
use glam::{DMat3, DVec3};
use serde::Serialize;

use super::median;
use super::pairs::rotation_angle_deg;
use crate::align::{RobustAlignment, align_rigid, align_robust, align_similarity, nearest_rotation};

/// The robust alignment counts a centre as right within this fraction of the reference's extent.
const ROBUST_DISTANCE_FRACTION: f64 = 0.02;

/// Samples of the robust alignment.
const ROBUST_TRIALS: usize = 500;

/// Distances between camera centres after alignment (absolute trajectory error), in units of the reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrajectoryError {
    /// Root of the mean square.
    pub rmse: f64,
    /// Median.
    pub median: f64,
    /// Largest.
    pub max: f64,
    /// `rmse` divided by the diagonal of the box around the reference's centres.
    pub rmse_over_extent: f64,
    /// Scale of the alignment: units of the reference per unit of the estimate.
    pub scale: f64,
}

/// Rotation errors after the common rotation that fits best (chordal mean), degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AbsoluteRotation {
    /// Median.
    pub median_deg: f64,
    /// Mean.
    pub mean_deg: f64,
    /// Largest.
    pub max_deg: f64,
}

pub(super) struct Trajectory {
    pub(super) similarity: Option<TrajectoryError>,
    pub(super) robust: Option<TrajectoryError>,
    pub(super) rigid: Option<TrajectoryError>,
    pub(super) rotation: Option<AbsoluteRotation>,
    pub(super) extent: f64,
}

/// Compares estimated with reference poses; everything but the extent needs three images.
pub(super) fn compare(poses: &[[Rigid3; 2]], reference_centers: &[DVec3], seed: u64) -> Trajectory {
    let extent = extent(reference_centers);
    let estimate: Vec<DVec3> = poses.iter().map(|p| p[0].center()).collect();
    let reference: Vec<DVec3> = poses.iter().map(|p| p[1].center()).collect();
    let measure = |motion: Similarity3| trajectory_error(&estimate, &reference, &motion, extent);
    let similarity = align_similarity(&estimate, &reference);
    let robust = RobustAlignment { max_distance: ROBUST_DISTANCE_FRACTION * extent, trials: ROBUST_TRIALS, seed };
    Trajectory {
        similarity: similarity.map(measure),
        robust: align_robust(&estimate, &reference, &robust).map(|(m, _)| m).or(similarity).map(measure),
        rigid: align_rigid(&estimate, &reference).map(measure),
        rotation: if poses.len() < 3 { None } else { absolute_rotation(poses) },
        extent,
    }
}

fn extent(centers: &[DVec3]) -> f64 {
    match centers {
        [] => 0.0,
        [first, ..] => {
            let (low, high) = centers.iter().fold((*first, *first), |(low, high), c| (low.min(*c), high.max(*c)));
            (high - low).length()
        }
    }
}

fn trajectory_error(a: &[DVec3], b: &[DVec3], motion: &Similarity3, extent: f64) -> TrajectoryError {
    let mut distances: Vec<f64> = a.iter().zip(b).map(|(a, b)| motion.transform_point(*a).distance(*b)).collect();
    let rmse = (distances.iter().map(|d| d * d).sum::<f64>() / distances.len() as f64).sqrt();
    let max = distances.iter().copied().fold(0.0, f64::max);
    TrajectoryError {
        rmse,
        median: median(&mut distances).unwrap_or(f64::NAN),
        max,
        rmse_over_extent: if extent > 0.0 { rmse / extent } else { 0.0 },
        scale: motion.scale,
    }
}

fn absolute_rotation(poses: &[[Rigid3; 2]]) -> Option<AbsoluteRotation> {
    let sum: DMat3 = poses
        .iter()
        .map(|[e, r]| r.rotation_matrix().transpose() * e.rotation_matrix())
        .fold(DMat3::ZERO, |sum, m| sum + m);
    let (reference_from_estimate, _) = nearest_rotation(&sum)?;
    let mut angles_deg: Vec<f64> = poses
        .iter()
        .map(|[e, r]| {
            let aligned = e.rotation_matrix() * reference_from_estimate.transpose();
            rotation_angle_deg(&(aligned * r.rotation_matrix().transpose()))
        })
        .collect();
    let mean_deg = angles_deg.iter().sum::<f64>() / angles_deg.len() as f64;
    let max_deg = angles_deg.iter().copied().fold(0.0, f64::max);
    Some(AbsoluteRotation { median_deg: median(&mut angles_deg)?, mean_deg, max_deg })
}
