//! How well the poses of one reconstruction agree with those of another: relative poses, camera centres, rotations.
//!
//! The definitions are those of the project's comparison script, number for number: relative poses of all pairs of
//! reference images, where a pair with an image that the estimate lacks counts as wrong by 180°.

mod auc;
mod names;
mod pairs;
mod trajectory;

use serde::Serialize;

use crate::Reconstruction;

pub use auc::{AUC_THRESHOLDS_DEG, Auc, area_under_recall};
pub use names::MatchBy;
pub use trajectory::{AbsoluteRotation, TrajectoryError};

use names::match_images;
use pairs::relative_pose_errors;

/// Settings of [`evaluate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaluateOptions {
    /// How image names are compared.
    pub match_by: MatchBy,
    /// Pairs of reference images not farther apart than this, in units of the reference, are judged by rotation alone.
    pub min_baseline: f64,
    /// Seed of the robust alignment.
    pub seed: u64,
}

impl Default for EvaluateOptions {
    fn default() -> Self {
        Self { match_by: MatchBy::Base, min_baseline: 0.0, seed: 0 }
    }
}

/// Median and mean of a set of angles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AngleSummary {
    /// Median, degrees.
    pub median_deg: f64,
    /// Mean, degrees.
    pub mean_deg: f64,
}

/// The result of [`evaluate`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Images of the estimate with different names.
    pub estimate_images: usize,
    /// Images of the reference with different names.
    pub reference_images: usize,
    /// Images both have.
    pub common_images: usize,
    /// Area under the recall curve over all pairs of reference images, missing ones counting 180°.
    pub auc_all: Auc,
    /// The same over pairs that the estimate has; `None` for fewer than two common images.
    pub auc_registered: Option<Auc>,
    /// Relative rotation errors of the pairs that the estimate has.
    pub relative_rotation: Option<AngleSummary>,
    /// Relative translation direction errors of the pairs that the estimate has.
    pub relative_direction: Option<AngleSummary>,
    /// Camera centres after a least-squares similarity; `None` for fewer than three common images.
    pub ate: Option<TrajectoryError>,
    /// Camera centres after a similarity that ignores outliers.
    pub ate_robust: Option<TrajectoryError>,
    /// Camera centres after a rigid motion: an error in scale counts.
    pub ate_rigid: Option<TrajectoryError>,
    /// How much longer the estimate's lengths are than the reference's, as a share of these: 0 for an estimate in the
    /// reference's units. From the similarity of `ate`.
    pub scale_error: Option<f64>,
    /// Rotations after the best common rotation.
    pub absolute_rotation: Option<AbsoluteRotation>,
    /// Diagonal of the box around the reference's camera centres, in its units.
    pub reference_extent: f64,
}

/// Compares the poses of an estimate with those of a reference.
pub fn evaluate(estimate: &Reconstruction, reference: &Reconstruction, options: &EvaluateOptions) -> Evaluation {
    let matched = match_images(estimate, reference, options.match_by);
    let errors = relative_pose_errors(&matched.common, options.min_baseline);
    let total_pairs = matched.reference_images * matched.reference_images.saturating_sub(1) / 2;
    let trajectory = trajectory::compare(&matched.common, &matched.reference_centers, options.seed);
    let has_pairs = !errors.combined_deg.is_empty();
    Evaluation {
        estimate_images: matched.estimate_images,
        reference_images: matched.reference_images,
        common_images: matched.common.len(),
        auc_all: Auc::over(&errors.combined_deg, total_pairs),
        auc_registered: has_pairs.then(|| Auc::over(&errors.combined_deg, errors.combined_deg.len())),
        relative_rotation: summarize(errors.rotation_deg),
        relative_direction: summarize(errors.direction_deg),
        ate: trajectory.similarity,
        scale_error: trajectory.similarity.map(|t| 1.0 / t.scale - 1.0),
        ate_robust: trajectory.robust,
        ate_rigid: trajectory.rigid,
        absolute_rotation: trajectory.rotation,
        reference_extent: trajectory.extent,
    }
}

fn summarize(mut angles_deg: Vec<f64>) -> Option<AngleSummary> {
    let mean_deg = angles_deg.iter().sum::<f64>() / angles_deg.len() as f64;
    Some(AngleSummary { median_deg: median(&mut angles_deg)?, mean_deg })
}

/// The median, the mean of the two middle values for an even count; reorders the values.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let n = values.len();
    if n == 0 {
        return None;
    }
    let (below, &mut upper, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 {
        return Some(upper);
    }
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some(0.5 * (lower + upper))
}

#[cfg(test)]
mod tests;
