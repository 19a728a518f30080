//! Depth maps against the reconstruction and against each other: the scale they agree on, and those that disagree.

use epipole_geometry::Similarity3;
use epipole_scene::{KeypointDepth, Reconstruction};
use glam::{DQuat, DVec3};

use super::depth_of;
use super::options::Options;

/// From so many standard deviations on a depth or a map is wrong, not noisy.
const OUTLIER_SIGMAS: f64 = 3.0;
/// Standard deviation of normal numbers over the median of their absolute values.
const SIGMA_PER_MAD: f64 = 1.4826;
/// Standard deviation of a median over that of a mean.
pub(super) const MEDIAN_LOSS: f64 = 1.2533;
/// Maps with fewer depths are not compared with the others: their median is noise.
const MIN_MAP_DEPTHS: usize = 8;
/// Reweighted solves of an affine fit.
const AFFINE_ROUNDS: usize = 10;

/// A depth and what the reconstruction has in its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// z of the point in the camera, world units; positive.
    pub(super) z: f64,
    pub(super) measured: KeypointDepth,
}

/// How a map's inverse depth is to be read: `1/z = scale · 1/ẑ + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MapFit {
    pub(super) scale: f64,
    /// 1/m.
    pub(super) shift: f64,
    /// The map contradicts the others and has a scale of its own, so that it no longer says anything about metres.
    pub(super) biased: bool,
}

impl Default for MapFit {
    fn default() -> Self {
        Self { scale: 1.0, shift: 0.0, biased: false }
    }
}

impl MapFit {
    /// The depth as it is to be believed; `None` where the fit puts it at infinity or behind.
    pub(super) fn depth_m(&self, z_m: f64) -> Option<f64> {
        let inverse = self.scale / z_m + self.shift;
        (inverse > 0.0 && inverse.is_finite()).then(|| 1.0 / inverse)
    }
}

/// What all maps say together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Verdict {
    /// Share of the depths within [`OUTLIER_SIGMAS`] of the reconstruction, after a scale of each map.
    pub(super) agreeing_share: f64,
    /// What lengths have to be multiplied by.
    pub(super) metres_per_unit: f64,
    /// Relative standard deviation of that, as the maps scatter.
    pub(super) relative_sigma: f64,
}

impl Verdict {
    /// Brings a reconstruction to metres.
    pub(super) fn apply(&self, reconstruction: &mut Reconstruction) {
        if self.metres_per_unit.is_finite() && self.metres_per_unit > 0.0 {
            let (scale, rotation, translation) = (self.metres_per_unit, DQuat::IDENTITY, DVec3::ZERO);
            reconstruction.transform(&Similarity3 { scale, rotation, translation });
        }
    }
}

/// All depths of points in front of their camera, by image.
pub(super) fn samples(reconstruction: &Reconstruction) -> Vec<Vec<Sample>> {
    let mut samples = vec![Vec::new(); reconstruction.images.len()];
    for point in &reconstruction.points {
        for &o in &point.observations {
            let Some(measured) = depth_of(reconstruction, o) else { continue };
            let z = reconstruction.images[o.image as usize].cam_from_world.transform_point(point.position).z;
            if z > 0.0 && z.is_finite() {
                samples[o.image as usize].push(Sample { z, measured });
            }
        }
    }
    samples
}

/// One map's logarithmic ratios of measured to reconstructed depth.
struct Ratios {
    median: f64,
    /// Robust standard deviation around the median.
    sigma: f64,
    count: usize,
}

/// Fits every map to the reconstruction and compares them. Scales of maps are relative to what all agree on.
pub(super) fn fit(samples: &[Vec<Sample>], options: &Options, maps: &mut [MapFit]) -> Verdict {
    let ratio = |s: &Sample| (s.measured.z_m / s.z).ln();
    let mut all: Vec<f64> = samples.iter().flatten().map(ratio).collect();
    let total = all.len();
    let pooled = median(&mut all).unwrap_or(0.0);
    let ratios: Vec<Option<Ratios>> = samples
        .iter()
        .map(|samples| {
            let mut values: Vec<f64> = samples.iter().map(ratio).collect();
            let median = median(&mut values)?;
            let sigma = SIGMA_PER_MAD * mad(&values, median);
            Some(Ratios { median, sigma, count: values.len() })
        })
        .collect();
    let mut medians: Vec<f64> =
        ratios.iter().flatten().filter(|r| r.count >= MIN_MAP_DEPTHS).map(|r| r.median).collect();
    // With too few maps to vote, the depths themselves do.
    let consensus = if medians.len() >= 3 { median(&mut medians).unwrap_or(pooled) } else { pooled };
    let between = SIGMA_PER_MAD * mad(&medians, consensus);
    let mut agreeing = 0;
    let mut voters = 0;
    for ((map, ratios), samples) in maps.iter_mut().zip(&ratios).zip(samples) {
        *map = MapFit::default();
        let Some(ratios) = ratios else { continue };
        let own = samples
            .iter()
            .filter(|s| (ratio(s) - ratios.median).abs() <= (1.0 + OUTLIER_SIGMAS * s.measured.relative_sigma).ln());
        agreeing += own.count();
        let bias = ratios.median - consensus;
        let sampling = MEDIAN_LOSS * ratios.sigma / (ratios.count as f64).sqrt();
        let limit = (OUTLIER_SIGMAS * between.hypot(sampling)).max(options.min_map_bias);
        map.biased = bias.abs() > limit;
        if options.affine {
            (map.scale, map.shift) = affine(samples, consensus, bias, options);
        } else if map.biased {
            // ẑ is exp(bias) times what the others have: 1/z = exp(bias) / ẑ.
            map.scale = bias.exp();
        }
        voters += usize::from(!map.biased && ratios.count >= MIN_MAP_DEPTHS);
    }
    let relative_sigma = match voters {
        // A single map: how its depths scatter.
        0..=2 => MEDIAN_LOSS * SIGMA_PER_MAD * mad(&all, consensus) / (total.max(1) as f64).sqrt(),
        _ => MEDIAN_LOSS * between / (voters as f64).sqrt(),
    };
    Verdict { agreeing_share: agreeing as f64 / total.max(1) as f64, metres_per_unit: consensus.exp(), relative_sigma }
}

/// Scale and shift of a map's inverse depth by reweighted least squares with bounded loss, held near the map's own median
/// ratio and no shift by soft priors.
fn affine(samples: &[Sample], consensus: f64, bias: f64, options: &Options) -> (f64, f64) {
    let mut inverse: Vec<f64> = samples.iter().map(|s| 1.0 / s.measured.z_m).collect();
    let typical = median(&mut inverse).unwrap_or(1.0);
    let start = bias.exp();
    let (mut scale, mut shift) = (start, 0.0);
    for _ in 0..AFFINE_ROUNDS {
        // Normal equations in (scale, shift / typical): both are of order one.
        let (prior_scale, prior_shift) = (options.affine_scale_sigma.powi(-2), options.affine_shift_sigma.powi(-2));
        let (mut aa, mut ab, mut bb) = (prior_scale, 0.0, prior_shift);
        let (mut ra, mut rb) = (prior_scale * start, 0.0);
        for s in samples {
            let target = (-consensus).exp() / s.z;
            let reference = 1.0 / s.measured.z_m;
            let whiten = 1.0 / (s.measured.relative_sigma * target);
            let residual = whiten * (scale * reference + shift - target);
            let weight = whiten.powi(2) * (1.0 + (residual / OUTLIER_SIGMAS).powi(2)).powi(-2);
            aa += weight * reference * reference;
            ab += weight * reference * typical;
            bb += weight * typical * typical;
            ra += weight * reference * target;
            rb += weight * typical * target;
        }
        let determinant = aa * bb - ab * ab;
        if !(determinant > 0.0 && determinant.is_finite()) {
            return (start, 0.0);
        }
        scale = (ra * bb - rb * ab) / determinant;
        shift = typical * (rb * aa - ra * ab) / determinant;
    }
    if scale > 0.0 && scale.is_finite() && shift.is_finite() { (scale, shift) } else { (start, 0.0) }
}

/// The upper median; sorts.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Median distance from a centre; 0 of nothing.
pub(super) fn mad(values: &[f64], center: f64) -> f64 {
    let mut distances: Vec<f64> = values.iter().map(|v| (v - center).abs()).collect();
    median(&mut distances).unwrap_or(0.0)
}
