//! What the depths came to, for the report and for people.

use std::fmt;

use epipole_scene::Reconstruction;
use serde::Serialize;

use super::maps::{self, median};
use super::{Metric, depth_of};

/// Depths beyond this many of their standard deviations are counted as outliers.
const OUTLIER_SIGMAS: f64 = 3.0;

/// The scale of a component and the depths behind it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MetricReport {
    /// Unit of all lengths in the model.
    pub unit: &'static str,
    /// Relative standard deviation of the scale as the maps scatter; what all maps have wrong alike is not in it.
    pub scale_relative_sigma: f64,
    /// Images with at least one depth among their observations.
    pub maps: usize,
    /// Maps that contradict the others and were given a scale of their own.
    pub biased_maps: Vec<String>,
    /// Observations with a depth.
    pub observations_with_depth: usize,
    /// Their share of all observations.
    pub observations_with_depth_share: f64,
    /// Median of `z / ẑ − 1`, `z` in the model, `ẑ` as given.
    pub median_relative_residual: f64,
    /// Median of its absolute value.
    pub median_absolute_relative_residual: f64,
    /// Share of the depths farther than three standard deviations from the model.
    pub outlier_share: f64,
}

impl fmt::Display for MetricReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "in metres, scale ± {:.2} %; {:.0} % of the observations have a depth ({} maps), median difference {:.1} %, \
             {:.0} % beyond 3 σ",
            100.0 * self.scale_relative_sigma,
            100.0 * self.observations_with_depth_share,
            self.maps,
            100.0 * self.median_absolute_relative_residual,
            100.0 * self.outlier_share
        )?;
        if !self.biased_maps.is_empty() {
            write!(f, "; {} maps contradict the others and have their own scale", self.biased_maps.len())?;
        }
        Ok(())
    }
}

impl Metric {
    /// Of a finished component; `None` where lengths are not metres.
    pub(crate) fn report(&self, reconstruction: &Reconstruction) -> Option<MetricReport> {
        if !self.is_metric() {
            return None;
        }
        let samples = maps::samples(reconstruction);
        let verdict = maps::fit(&samples, &self.options, &mut self.maps.clone());
        let mut relative: Vec<f64> = samples.iter().flatten().map(|s| s.z / s.measured.z_m - 1.0).collect();
        let mut absolute: Vec<f64> = relative.iter().map(|r| r.abs()).collect();
        let outliers = samples.iter().zip(&self.maps).flat_map(|(samples, map)| {
            samples.iter().filter(|s| match map.depth_m(s.measured.z_m) {
                Some(z_m) => (z_m / s.z - 1.0).abs() > OUTLIER_SIGMAS * s.measured.relative_sigma,
                None => true,
            })
        });
        let outlier_share = outliers.count() as f64 / relative.len().max(1) as f64;
        let observations = reconstruction.points.iter().flat_map(|point| &point.observations);
        let with_depth = observations.filter(|&&o| depth_of(reconstruction, o).is_some()).count();
        let biased = reconstruction.images.iter().zip(&self.maps).filter(|(_, map)| map.biased);
        Some(MetricReport {
            unit: "m",
            scale_relative_sigma: verdict.relative_sigma,
            maps: samples.iter().filter(|samples| !samples.is_empty()).count(),
            biased_maps: biased.map(|(image, _)| image.name.clone()).collect(),
            observations_with_depth: with_depth,
            observations_with_depth_share: with_depth as f64 / reconstruction.num_observations().max(1) as f64,
            median_relative_residual: median(&mut relative).unwrap_or(0.0),
            median_absolute_relative_residual: median(&mut absolute).unwrap_or(0.0),
            outlier_share,
        })
    }
}
