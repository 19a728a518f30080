//! The area under the recall curve of pose errors, the usual score of pose estimation.

use serde::Serialize;

/// The thresholds that are reported, degrees.
pub const AUC_THRESHOLDS_DEG: [f64; 4] = [1.0, 3.0, 5.0, 10.0];

/// Areas under the recall curve, percent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Auc {
    /// Up to 1°.
    pub at_1: f64,
    /// Up to 3°.
    pub at_3: f64,
    /// Up to 5°.
    pub at_5: f64,
    /// Up to 10°.
    pub at_10: f64,
}

impl Auc {
    /// From the errors found, out of `total` pairs; those that are missing from the errors count as wrong.
    pub(super) fn over(errors_deg: &[f64], total: usize) -> Self {
        let [at_1, at_3, at_5, at_10] =
            AUC_THRESHOLDS_DEG.map(|threshold| 100.0 * area_under_recall(errors_deg, total, threshold));
        Self { at_1, at_3, at_5, at_10 }
    }
}

/// The exact area under the step function "fraction of `total` with an error below e", for e from 0 to the threshold,
/// divided by the threshold: 0 to 1. Zero if `total` is.
pub fn area_under_recall(errors: &[f64], total: usize, threshold: f64) -> f64 {
    if total == 0 {
        return 0.0;
    }
    errors.iter().map(|e| (threshold - e).max(0.0)).sum::<f64>() / (threshold * total as f64)
}
