//! Relative poses: makes sure that every pair that stays in the view graph has one, and that it holds for the
//! intrinsics the pipeline works with.
//!
//! Stored poses are taken where they are there and were found with the present focal lengths; else the stored matrices
//! are decomposed and refined on the verified matches, or the pose is estimated from them anew. With raw matches all
//! pairs are verified again. Every pair is a problem by itself (`problem.rs`), solved by all threads, by a tab's one worker, or
//! by helpers of it (`pool.rs`).

mod encoding;
mod pool;
mod problem;
mod work;

use epipole_geometry::camera::Camera;
use epipole_geometry::two_view::PoseSource;
use epipole_scene::ViewGraph;
use serde::{Deserialize, Serialize};

use crate::error::MapperError;
use crate::event::{Event, Observer, breath};
use crate::options::Matches;
pub use encoding::solve_pairs;
use pool::share;
pub use pool::{Answering, PairPool};
use problem::Found;
use work::{Work, existing};

/// Pairs between two looks at whether a person wants to stop: a few tenths of a second of work on all cores; in a browser
/// tab, on one, a single pair can take half of that.
const PAIRS_AT_ONCE: usize = if cfg!(feature = "rayon") { 512 } else { 1 };

/// Helpers are started when the stage has been at work so long, and has so much left by what a pair took: they need a tenth of a
/// second until they do anything.
const TRIAL_SECONDS: f64 = 0.1;
const WORTH_SECONDS: f64 = 0.4;

/// Work of a batch for a helper: sending it costs a hundredth of that, and after a pause the processors come to rest at once.
const BATCH_SECONDS: f64 = 0.1;

/// Which pairs are usable, and where their poses come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Fewest verified matches of a pair.
    pub min_inliers: usize,
    /// Verified matches that a pose is found from, at most: more add time but no digits that rotation averaging would keep.
    pub max_matches: usize,
    /// Fewest inliers of a pair verified again from raw matches.
    pub min_inliers_raw: usize,
    /// Smallest share of a pair's matches that must agree with a pose that was found here.
    pub min_inlier_ratio: f64,
    /// Whether poses that the database holds are used as they are; else they are found again from the matrices.
    pub use_stored: bool,
    /// A stored pose is found again where the focal length it was found with differs by more than this share.
    pub max_focal_change: f64,
    /// Largest tangent Sampson error of an inlier, px.
    pub max_error_px: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            // COLMAP's `min_num_matches` of its database cache (algorithms.md §2.1).
            min_inliers: 15,
            // The error of a pose falls with the root of the matches: at 1000 it is far below the disagreement of pairs.
            max_matches: 1000,
            // GLOMAP's filters after its own relative poses (algorithms.md §2.3).
            min_inliers_raw: 30,
            min_inlier_ratio: 0.25,
            use_stored: true,
            // A focal length 1 % off turns a relative rotation by about 1 % of its angle: below the noise of a pair.
            max_focal_change: 0.01,
            // COLMAP's two-view threshold, with which the verified matches were chosen (algorithms.md §2.2).
            max_error_px: 4.0,
        }
    }
}

/// What became of the pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Pairs whose stored pose is used.
    pub stored: usize,
    /// Pairs whose pose was decomposed from stored matrices and refined.
    pub decomposed: usize,
    /// Pairs whose pose was estimated from matches.
    pub estimated: usize,
    /// Pairs dropped because of their label (undefined, degenerate, watermark, multiple) or too few matches.
    pub weak: usize,
    /// Pairs dropped because no pose agrees with enough of their matches.
    pub without_pose: usize,
    /// Helpers that took part.
    pub helpers: usize,
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} stored, {} decomposed, {} estimated; dropped {} weak and {} without a pose",
            self.stored, self.decomposed, self.estimated, self.weak, self.without_pose
        )?;
        if self.helpers > 0 { write!(f, "; by {} workers", self.helpers) } else { Ok(()) }
    }
}

/// Gives every usable pair a relative pose and removes the others from the graph.
///
/// Deterministic for a seed, with and without a pool. With [`Matches::Raw`] the inliers and matrices of the pairs are
/// replaced as well; pairs whose raw matches were not read keep their verified ones, with a warning.
///
/// # Errors
/// [`MapperError::Stopped`] when the observer asks to stop.
pub async fn run(
    graph: &mut ViewGraph,
    options: &Options,
    matches: Matches,
    seed: u64,
    pool: Option<&mut dyn PairPool>,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    let missing = graph.pairs.iter().filter(|p| p.matches.is_none() && p.num_matches > 0).count();
    if matches == Matches::Raw && missing > 0 {
        let message = format!("{missing} pairs have no raw matches here: their verified matches are used instead");
        observer.event(&Event::Warning { message });
    }
    let mut work = Work::new(graph, options, matches, seed);
    observer.event(&work.progress());
    breath(observer).await;
    if observer.should_stop() {
        return Err(MapperError::Stopped);
    }
    let at_once = if pool.is_some() { 1 } else { PAIRS_AT_ONCE };
    let mut helpers = 0;
    if let Some(pool) = pool {
        let (start, known) = (observer.now_seconds(), work.settled);
        work.solve_here(at_once, TRIAL_SECONDS, observer).await?;
        let seconds_per_pair = (observer.now_seconds() - start) / (work.settled - known) as f64;
        if seconds_per_pair * work.waiting.len() as f64 >= WORTH_SECONDS {
            helpers = share(&mut work, (BATCH_SECONDS / seconds_per_pair) as usize, pool, observer).await?;
        }
    }
    work.solve_here(at_once, f64::INFINITY, observer).await?;
    let found = work.found;
    let mut summary = Summary { helpers, ..Summary::default() };
    let mut pairs = Vec::with_capacity(found.len());
    for (mut pair, found) in std::mem::take(&mut graph.pairs).into_iter().zip(found) {
        // None is left that waits.
        match found.unwrap_or(Found::WithoutPose) {
            Found::Weak => summary.weak += 1,
            Found::WithoutPose => summary.without_pose += 1,
            Found::Stored => {
                summary.stored += 1;
                pairs.push(pair);
            }
            Found::Pose(pose, source) => {
                match source {
                    PoseSource::Stored => summary.decomposed += 1,
                    PoseSource::Estimated => summary.estimated += 1,
                }
                pair.cam2_from_cam1 = Some(pose);
                pair.solver_cameras = [None, None];
                pairs.push(pair);
            }
            Found::Verified(geometry) => {
                summary.estimated += 1;
                let raw = existing(graph, &pair, pair.matches.as_deref().unwrap_or_default());
                pair.inliers = geometry.inliers.iter().filter_map(|&m| raw.get(m as usize).copied()).collect();
                pair.config = geometry.config;
                pair.cam2_from_cam1 = geometry.cam2_from_cam1;
                pair.essential = geometry.essential;
                pair.fundamental = geometry.fundamental;
                pair.homography = geometry.homography;
                pair.solver_cameras = [None, None];
                pairs.push(pair);
            }
        }
    }
    graph.pairs = pairs;
    Ok(summary)
}

/// |log| of the ratio of two cameras' focal lengths; infinite where there is none.
pub(super) fn focal_change(a: &Camera, b: &Camera) -> f64 {
    let ratio = (a.mean_focal_px() / b.mean_focal_px()).ln().abs();
    if ratio.is_nan() { f64::INFINITY } else { ratio }
}

#[cfg(test)]
mod pool_tests;
#[cfg(test)]
mod tests;
