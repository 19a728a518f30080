//! Distances between two point clouds: accuracy, completeness, and their mean, the Chamfer distance.

use glam::DVec3;
use serde::Serialize;

use crate::evaluate::median;
use crate::kd_tree::KdTree;

/// Distances from every point of one cloud to the nearest point of the other, in the units of the clouds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CloudDistance {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Nine in ten are closer.
    pub percentile_90: f64,
    /// Nineteen in twenty are closer.
    pub percentile_95: f64,
}

/// How close two clouds are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Chamfer {
    /// From the estimate to the reference: what is there is right.
    pub accuracy: CloudDistance,
    /// From the reference to the estimate: what should be there is.
    pub completeness: CloudDistance,
    /// Mean of the two means. (Others take the sum: twice this.)
    pub mean: f64,
    /// Mean of the two medians.
    pub median: f64,
}

/// Compares two clouds in the same frame and units; points that are not finite are left out. `None` if either is empty.
pub fn chamfer(estimate: &[DVec3], reference: &[DVec3]) -> Option<Chamfer> {
    let (estimate_tree, reference_tree) =
        (KdTree::new(estimate.iter().copied()), KdTree::new(reference.iter().copied()));
    let accuracy = distances(estimate, &reference_tree)?;
    let completeness = distances(reference, &estimate_tree)?;
    Some(Chamfer {
        accuracy,
        completeness,
        mean: 0.5 * (accuracy.mean + completeness.mean),
        median: 0.5 * (accuracy.median + completeness.median),
    })
}

fn distances(from: &[DVec3], to: &KdTree) -> Option<CloudDistance> {
    let mut all: Vec<f64> = from.iter().filter_map(|p| to.nearest_distance(*p)).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    Some(CloudDistance {
        mean,
        median: median(&mut all)?,
        percentile_90: percentile(&mut all, 0.90)?,
        percentile_95: percentile(&mut all, 0.95)?,
    })
}

/// The smallest value that at least this share of all values does not exceed; reorders the values.
fn percentile(values: &mut [f64], share: f64) -> Option<f64> {
    let rank = (share * values.len() as f64).ceil() as usize;
    let index = rank.saturating_sub(1);
    (index < values.len()).then(|| *values.select_nth_unstable_by(index, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_directions_are_told_apart() {
        let reference: Vec<_> = (0..10).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
        // Half of the line, 0.1 beside it: accurate, but incomplete.
        let estimate: Vec<_> = reference[..5].iter().map(|p| *p + DVec3::new(0.0, 0.1, 0.0)).collect();
        let found = chamfer(&estimate, &reference).expect("two clouds");
        assert!((found.accuracy.mean - 0.1).abs() < 1e-12 && (found.accuracy.median - 0.1).abs() < 1e-12);
        let missing = |d: f64| (d * d + 0.01f64).sqrt();
        let expected = (0.5 + (1..=5).map(|d| missing(f64::from(d))).sum::<f64>()) / 10.0;
        assert!((found.completeness.mean - expected).abs() < 1e-12);
        assert!((found.completeness.median - 0.5 * (0.1 + missing(1.0))).abs() < 1e-12);
        assert!((found.mean - 0.5 * (0.1 + expected)).abs() < 1e-12);
        // Ten distances: the ninth and the tenth.
        assert!((found.completeness.percentile_90 - missing(4.0)).abs() < 1e-12);
        assert!((found.completeness.percentile_95 - missing(5.0)).abs() < 1e-12);
        assert_eq!(chamfer(&[], &reference), None);
        assert_eq!(chamfer(&reference, &[DVec3::NAN]), None);
    }
}
