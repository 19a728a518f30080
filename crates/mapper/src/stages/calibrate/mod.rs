//! View-graph calibration: focal lengths that the database only guessed, from the fundamental matrices of all pairs.
//!
//! Every pair gives a sample of the focal length of each of its images; each camera takes the focal length that
//! explains its samples best under a Cauchy loss. Fetzer et al. (WACV 2020) minimise the same loss over all cameras at
//! once; at real focal lengths their problem falls apart into one per camera but for the common weight of a pair's two
//! residuals (algorithms.md §2.4), so a scan finds its minimum and cannot diverge. A focal length is only taken where
//! enough pairs agree on it; and cameras whose focal length is known are left alone and help the others.

mod bougnoux;

use epipole_geometry::camera::{Camera, CameraFamily};
use epipole_geometry::two_view::calibration_matrix;
use epipole_scene::{Pair, PairConfig, ViewGraph};
use glam::DMat3;
use serde::{Deserialize, Serialize};

use super::relative_pose::focal_change;
use crate::error::MapperError;
use crate::event::{Event, Observer};
use crate::parallel;
use bougnoux::squared_focals;

/// Step of the first scan in log f. A third of the width of the loss, so that no minimum falls between two steps.
const SCAN_STEP: f64 = 0.015;

/// Rounds over all cameras after the first, in which both residuals of a pair share their weight.
const JOINT_ROUNDS: usize = 3;

/// Steps of the golden-section search; each shrinks the bracket by 0.62, 24 bring 0.03 below 1e-6.
const GOLDEN_STEPS: usize = 24;

/// When focal lengths are estimated and believed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Whether to calibrate at all.
    pub enabled: bool,
    /// Scale of the Cauchy loss on `1 − sample²/f²`.
    pub cauchy_scale: f64,
    /// Smallest focal length, as a multiple of the guess.
    pub min_focal_ratio: f64,
    /// Largest focal length, as a multiple of the guess.
    pub max_focal_ratio: f64,
    /// Fewest pairs that must agree with a focal length.
    pub min_support: usize,
    /// Smallest share of a camera's pairs that must agree.
    pub min_support_ratio: f64,
    /// A pair agrees with a focal length when `|1 − sample²/f²|` is below this.
    pub support_residual: f64,
    /// Pairs whose residuals have a norm above this are dropped; `None` leaves the judgement to the inlier count of the
    /// relative pose at the new focal length.
    pub max_pair_residual: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            enabled: true,
            // COLMAP has 0.01, half a percent of f. Half of bonsai292's samples lie within 5 % of the truth, and any scale
            // from 0.01 to 0.2 gives 819 to 823 px there (truth 827); with few samples a wide one is steadier.
            cauchy_scale: 0.1,
            // COLMAP's limits (algorithms.md §2.4).
            min_focal_ratio: 0.1,
            max_focal_ratio: 10.0,
            // Share of samples that agree, with known focal lengths hidden: bonsai292 0.69 and Herz-Jesus-P25 0.64 (both
            // within 1 % of the truth), lund_door 0.82 (7 % high: its distortion is not modelled), sevenscenes 0.29
            // (5 % off), castle-P19 0.20, kermit 0.14, templering19 and sceaux_castle below 0.02 (far off).
            min_support: 5,
            min_support_ratio: 0.3,
            // 10 % of f.
            support_residual: 0.2,
            // COLMAP drops pairs above 2, and with them sound pairs whose motion says nothing about the focal length.
            max_pair_residual: None,
        }
    }
}

/// A camera whose focal length was estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedCamera {
    /// Index into [`ViewGraph::cameras`].
    pub camera: usize,
    /// The guess, px.
    pub old_focal_px: f64,
    /// The estimate, px.
    pub new_focal_px: f64,
    /// Samples that agree with it.
    pub support: usize,
    /// All samples of the camera.
    pub samples: usize,
}

/// What calibration did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Cameras whose focal length was estimated and is now used.
    pub calibrated: Vec<CalibratedCamera>,
    /// Cameras whose focal length remains a guess: too few pairs agree on one.
    pub still_guessed: usize,
    /// Pairs whose stored pose no longer holds and was cleared.
    pub cleared_poses: usize,
    /// Pairs dropped for [`Options::max_pair_residual`].
    pub dropped_pairs: usize,
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} focal lengths estimated, {} still guessed", self.calibrated.len(), self.still_guessed)?;
        if let Some(c) = self.calibrated.first() {
            write!(f, " (first: {:.1} → {:.1} px)", c.old_focal_px, c.new_focal_px)?;
        }
        Ok(())
    }
}

/// The two samples of a pair.
struct PairSample {
    pair: usize,
    cameras: [usize; 2],
    squared_focals: [f64; 2],
}

/// Estimates the focal lengths of all perspective cameras that have none from EXIF or a person, and uses them: the
/// cameras' parameters change, their focal lengths count as known, and poses that were found with other focal lengths are
/// cleared for [`super::relative_pose`] to find again.
///
/// # Errors
/// None so far; the signature is that of the other stages.
pub fn run(graph: &mut ViewGraph, options: &Options, observer: &mut dyn Observer) -> Result<Summary, MapperError> {
    let guessed: Vec<bool> = graph.cameras.iter().map(|c| !c.has_prior_focal && is_calibratable(c)).collect();
    let mut summary = Summary::default();
    if !options.enabled || !guessed.contains(&true) {
        summary.still_guessed = graph.cameras.iter().filter(|c| !c.has_prior_focal).count();
        return Ok(summary);
    }
    let samples = samples(graph, &guessed);
    let mut of_camera: Vec<Vec<(usize, usize)>> = vec![Vec::new(); graph.cameras.len()];
    for (s, sample) in samples.iter().enumerate() {
        for side in 0..2 {
            of_camera[sample.cameras[side]].push((s, side));
        }
    }
    let guess: Vec<f64> = graph.cameras.iter().map(Camera::mean_focal_px).collect();
    let focals = estimate(&samples, &of_camera, &guess, &guessed, options);
    let before = graph.cameras.clone();
    for camera in (0..graph.cameras.len()).filter(|&c| guessed[c]) {
        let agrees = |&&(s, side): &&(usize, usize)| {
            (1.0 - samples[s].squared_focals[side] / focals[camera].powi(2)).abs() < options.support_residual
        };
        let (support, total) = (of_camera[camera].iter().filter(agrees).count(), of_camera[camera].len());
        let ratio = focals[camera] / guess[camera];
        // A minimum at the end of the range is no minimum.
        let inside = ratio > 1.01 * options.min_focal_ratio && ratio < 0.99 * options.max_focal_ratio;
        if inside && support >= options.min_support && support as f64 >= options.min_support_ratio * total as f64 {
            graph.cameras[camera].set_focal_px(focals[camera]);
            graph.cameras[camera].has_prior_focal = true;
            summary.calibrated.push(CalibratedCamera {
                camera,
                old_focal_px: guess[camera],
                new_focal_px: focals[camera],
                support,
                samples: total,
            });
        }
    }
    summary.still_guessed = graph.cameras.iter().filter(|c| !c.has_prior_focal).count();
    if summary.still_guessed > 0 {
        let message = format!(
            "{} of {} cameras have a guessed focal length that the pairs do not settle; give focal lengths if they are known",
            summary.still_guessed,
            graph.cameras.len()
        );
        observer.event(&Event::Warning { message });
    }
    summary.cleared_poses = clear_stale_poses(graph, &before);
    if let Some(limit) = options.max_pair_residual {
        summary.dropped_pairs = drop_pairs(graph, &samples, &summary, limit);
    }
    Ok(summary)
}

/// One focal length to estimate, and a fundamental matrix to do it with.
fn is_calibratable(camera: &Camera) -> bool {
    camera.model.family() == CameraFamily::Perspective && camera.validate().is_ok()
}

/// The samples of all pairs with an epipolar geometry and at least one guessed camera.
fn samples(graph: &ViewGraph, guessed: &[bool]) -> Vec<PairSample> {
    let one = |pair: usize, p: &Pair| {
        if !matches!(p.config, PairConfig::Calibrated | PairConfig::Uncalibrated) {
            return None;
        }
        let cameras = [graph.images[p.image1].camera, graph.images[p.image2].camera];
        let [c1, c2] = cameras.map(|c| &graph.cameras[c]);
        if !cameras.iter().any(|&c| guessed[c]) || !is_calibratable(c1) || !is_calibratable(c2) {
            return None;
        }
        let fundamental = p.fundamental.or_else(|| fundamental_from_essential(p, c1, c2))?;
        let squared_focals = squared_focals(&fundamental, c1.principal_point_px(), c2.principal_point_px());
        let usable = squared_focals.iter().all(|s| s.is_finite());
        usable.then_some(PairSample { pair, cameras, squared_focals })
    };
    graph.pairs.iter().enumerate().filter_map(|(i, p)| one(i, p)).collect()
}

/// `K2⁻ᵀ E K1⁻¹` with the intrinsics that `E` was found with.
fn fundamental_from_essential(pair: &Pair, camera1: &Camera, camera2: &Camera) -> Option<DMat3> {
    let [k1, k2] = [(&pair.solver_cameras[0], camera1), (&pair.solver_cameras[1], camera2)]
        .map(|(solver, camera)| calibration_matrix(solver.as_ref().unwrap_or(camera)).inverse());
    Some(k2.transpose() * pair.essential? * k1)
}

/// The focal length of every camera that fits its samples best, px; the guess where there are none.
fn estimate(
    samples: &[PairSample],
    of_camera: &[Vec<(usize, usize)>],
    guess: &[f64],
    guessed: &[bool],
    options: &Options,
) -> Vec<f64> {
    let own = |sample: &PairSample, side: usize, squared: f64| (1.0 - sample.squared_focals[side] / squared).powi(2);
    let loss = |squared_residual: f64| (squared_residual / options.cauchy_scale.powi(2)).ln_1p();
    let range = [options.min_focal_ratio.ln(), options.max_focal_ratio.ln()];
    let cameras: Vec<usize> = (0..guess.len()).collect();
    let mut focals = parallel::map(&cameras, |_, &camera| {
        if !guessed[camera] || of_camera[camera].is_empty() {
            return guess[camera];
        }
        let cost = |log_ratio: f64| {
            let squared = (guess[camera] * log_ratio.exp()).powi(2);
            of_camera[camera].iter().map(|&(s, side)| loss(own(&samples[s], side, squared))).sum::<f64>()
        };
        let steps = ((range[1] - range[0]) / SCAN_STEP).ceil().max(1.0) as usize;
        let at = |step: usize| range[0] + SCAN_STEP * step as f64;
        let scan = (0..=steps).map(|step| (cost(at(step)), step));
        let best = scan.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |(_, step)| at(step));
        guess[camera] * golden_section(cost, best - SCAN_STEP, best + SCAN_STEP).exp()
    });
    for _ in 0..JOINT_ROUNDS {
        for &camera in cameras.iter().filter(|&&c| guessed[c] && !of_camera[c].is_empty()) {
            let cost = |log_focal: f64| {
                let squared = (2.0 * log_focal).exp();
                let of_pair = |&(s, side): &(usize, usize)| {
                    let other = samples[s].cameras[1 - side];
                    let same = other == camera;
                    let other_squared = if same { squared } else { focals[other].powi(2) };
                    let both = own(&samples[s], side, squared) + own(&samples[s], 1 - side, other_squared);
                    // A pair of one camera stands twice in its list.
                    if same { 0.5 * loss(both) } else { loss(both) }
                };
                of_camera[camera].iter().map(of_pair).sum::<f64>()
            };
            let now = focals[camera].ln();
            let found = golden_section(cost, now - 2.0 * SCAN_STEP, now + 2.0 * SCAN_STEP);
            if cost(found) < cost(now) {
                focals[camera] = found.exp();
            }
        }
    }
    focals
}

/// The minimum of a function with one minimum in a bracket.
fn golden_section(cost: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_8;
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut cost_a, mut cost_b) = (cost(a), cost(b));
    for _ in 0..GOLDEN_STEPS {
        if cost_a < cost_b {
            (high, b, cost_b) = (b, a, cost_a);
            a = high - RATIO * (high - low);
            cost_a = cost(a);
        } else {
            (low, a, cost_a) = (a, b, cost_b);
            b = low + RATIO * (high - low);
            cost_b = cost(b);
        }
    }
    0.5 * (low + high)
}

/// Clears the poses (and essential matrices) that were found with another focal length than the cameras have now, and
/// leaves the fundamental matrix of such a pair in their place; their number.
fn clear_stale_poses(graph: &mut ViewGraph, before: &[Camera]) -> usize {
    // A quarter of the change that `relative_pose::Options::max_focal_change` lets pass as harmless.
    const SAME_FOCAL: f64 = 0.0025;
    let mut cleared = 0;
    for pair in &mut graph.pairs {
        let cameras = [graph.images[pair.image1].camera, graph.images[pair.image2].camera];
        let stale = (0..2).any(|side| {
            let found_with = pair.solver_cameras[side].as_ref().unwrap_or(&before[cameras[side]]);
            let changed = graph.cameras[cameras[side]] != before[cameras[side]];
            changed && focal_change(found_with, &graph.cameras[cameras[side]]) > SAME_FOCAL
        });
        if !stale {
            continue;
        }
        if pair.fundamental.is_none() {
            pair.fundamental = fundamental_from_essential(pair, &before[cameras[0]], &before[cameras[1]]);
        }
        cleared += usize::from(pair.cam2_from_cam1.take().is_some());
        pair.essential = None;
        pair.solver_cameras = [None, None];
    }
    cleared
}

/// Drops the pairs of calibrated cameras whose samples are too far off; their number.
fn drop_pairs(graph: &mut ViewGraph, samples: &[PairSample], summary: &Summary, limit: f64) -> usize {
    let mut keep = vec![true; graph.pairs.len()];
    for sample in samples {
        let calibrated = summary.calibrated.iter().any(|c| sample.cameras.contains(&c.camera));
        let residual = |side: usize| {
            1.0 - sample.squared_focals[side] / graph.cameras[sample.cameras[side]].mean_focal_px().powi(2)
        };
        keep[sample.pair] = !calibrated || residual(0).hypot(residual(1)) <= limit;
    }
    let mut keep_of = keep.iter();
    graph.pairs.retain(|_| keep_of.next().is_none_or(|&k| k));
    keep.iter().filter(|&&k| !k).count()
}

#[cfg(test)]
mod tests;
