//! Relative poses: makes sure that every pair that stays in the view graph has one, and that it holds for the
//! intrinsics the pipeline works with.
//!
//! Stored poses are taken where they are there and were found with the present focal lengths; else the stored matrices
//! are decomposed and refined on the verified matches, or the pose is estimated from them anew. With raw matches all
//! pairs are verified again.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use epipole_geometry::two_view::{
    PoseSource, RansacOptions, RelativePoseOptions, TwoViewOptions, estimate_two_view, relative_pose_from_geometry,
};
use epipole_scene::{Pair, ViewGraph};
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};
use crate::options::Matches;
use crate::parallel;

/// Pairs between two looks at whether a person wants to stop: a few tenths of a second of work on all cores; in a browser
/// tab, on one, a single pair can take half of that.
const PAIRS_PER_CHUNK: usize = if cfg!(feature = "rayon") { 512 } else { 1 };

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
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} stored, {} decomposed, {} estimated; dropped {} weak and {} without a pose",
            self.stored, self.decomposed, self.estimated, self.weak, self.without_pose
        )
    }
}

/// What was found for a pair; `None` drops it.
enum Found {
    Stored,
    Pose(Rigid3, PoseSource),
    Verified(Box<epipole_geometry::two_view::TwoViewGeometry>),
    Weak,
    WithoutPose,
}

/// Gives every usable pair a relative pose and removes the others from the graph.
///
/// Deterministic for a seed. With [`Matches::Raw`] the inliers and matrices of the pairs are replaced as well; pairs
/// whose raw matches were not read keep their verified ones, with a warning.
///
/// # Errors
/// [`MapperError::Stopped`] when the observer asks to stop.
pub async fn run(
    graph: &mut ViewGraph,
    options: &Options,
    matches: Matches,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    let missing = graph.pairs.iter().filter(|p| p.matches.is_none() && p.num_matches > 0).count();
    if matches == Matches::Raw && missing > 0 {
        let message = format!("{missing} pairs have no raw matches here: their verified matches are used instead");
        observer.event(&Event::Warning { message });
    }
    let total = graph.pairs.len();
    let mut found = Vec::with_capacity(total);
    for chunk in graph.pairs.chunks(PAIRS_PER_CHUNK) {
        if observer.should_stop() {
            return Err(MapperError::Stopped);
        }
        found.extend(parallel::map(chunk, |_, pair| find(graph, pair, options, matches, seed)));
        observer.event(&Event::Progress { stage: Stage::RelativePose, done: found.len(), total });
        breath(observer).await;
    }
    let mut summary = Summary::default();
    let mut pairs = Vec::with_capacity(total);
    for (mut pair, found) in std::mem::take(&mut graph.pairs).into_iter().zip(found) {
        match found {
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
                let raw = pair.matches.as_deref().unwrap_or_default();
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

/// At most `max` of the matches, evenly spread over their order.
fn thinned(matches: Vec<[u32; 2]>, max: usize) -> Vec<[u32; 2]> {
    if matches.len() <= max {
        return matches;
    }
    (0..max).map(|i| matches[i * matches.len() / max]).collect()
}

fn find(graph: &ViewGraph, pair: &Pair, options: &Options, matches: Matches, seed: u64) -> Found {
    let seed = pair_seed(graph, pair, seed);
    if matches == Matches::Raw
        && let Some(raw) = &pair.matches
    {
        return verify_raw(graph, pair, raw, options, seed);
    }
    let config = pair.config;
    if !config.has_pose() || pair.inliers.len() < options.min_inliers {
        return Found::Weak;
    }
    if options.use_stored && stored_pose_holds(graph, pair, options) {
        return Found::Stored;
    }
    let (image1, image2) = (&graph.images[pair.image1], &graph.images[pair.image2]);
    let inside =
        |&&[a, b]: &&[u32; 2]| (a as usize) < image1.keypoints_px.len() && (b as usize) < image2.keypoints_px.len();
    let usable: Vec<[u32; 2]> = pair.inliers.iter().filter(inside).copied().collect();
    let usable = thinned(usable, options.max_matches);
    let points1: Vec<DVec2> = usable.iter().map(|m| image1.keypoints_px[m[0] as usize]).collect();
    let points2: Vec<DVec2> = usable.iter().map(|m| image2.keypoints_px[m[1] as usize]).collect();
    let pose = relative_pose_from_geometry(
        config,
        pair.essential.as_ref(),
        pair.fundamental.as_ref(),
        pair.homography.as_ref(),
        &graph.cameras[image1.camera],
        &points1,
        &graph.cameras[image2.camera],
        &points2,
        &relative_pose_options(options),
        seed,
    );
    let enough = |agreeing: usize| {
        agreeing >= options.min_inliers && agreeing as f64 >= options.min_inlier_ratio * usable.len() as f64
    };
    match pose {
        Some(p) if p.cam2_from_cam1.is_finite() && enough(p.inliers.len()) => Found::Pose(p.cam2_from_cam1, p.source),
        _ => Found::WithoutPose,
    }
}

fn verify_raw(graph: &ViewGraph, pair: &Pair, raw: &[[u32; 2]], options: &Options, seed: u64) -> Found {
    if raw.len() < options.min_inliers_raw {
        return Found::Weak;
    }
    let (image1, image2) = (&graph.images[pair.image1], &graph.images[pair.image2]);
    let two_view = TwoViewOptions {
        relative_pose: relative_pose_options(options),
        min_num_inliers: options.min_inliers,
        ..TwoViewOptions::default()
    };
    let geometry = estimate_two_view(
        &graph.cameras[image1.camera],
        &image1.keypoints_px,
        &graph.cameras[image2.camera],
        &image2.keypoints_px,
        raw,
        &two_view,
        seed,
    );
    if !geometry.config.has_pose() {
        return Found::Weak;
    }
    let inliers = geometry.inliers.len();
    let enough = inliers >= options.min_inliers_raw && inliers as f64 >= options.min_inlier_ratio * raw.len() as f64;
    if enough && geometry.cam2_from_cam1.is_some_and(|pose| pose.is_finite()) {
        Found::Verified(Box::new(geometry))
    } else {
        Found::WithoutPose
    }
}

fn relative_pose_options(options: &Options) -> RelativePoseOptions {
    let ransac = RansacOptions { max_error_px: options.max_error_px, ..RansacOptions::default() };
    RelativePoseOptions { ransac, ..RelativePoseOptions::default() }
}

/// Whether the pair has a pose that was found with the cameras' present focal lengths. Where a focal length is only a
/// guess, the one that the two-view solver estimated with the pose is the better of the two.
fn stored_pose_holds(graph: &ViewGraph, pair: &Pair, options: &Options) -> bool {
    let holds = |solver: &Option<Camera>, image: usize| {
        let camera = &graph.cameras[graph.images[image].camera];
        match solver {
            Some(solver) if camera.has_prior_focal => focal_change(solver, camera) <= options.max_focal_change,
            _ => true,
        }
    };
    let [solver1, solver2] = &pair.solver_cameras;
    pair.cam2_from_cam1.is_some_and(|pose| pose.is_finite())
        && holds(solver1, pair.image1)
        && holds(solver2, pair.image2)
}

/// |log| of the ratio of two cameras' focal lengths; infinite where there is none.
pub(super) fn focal_change(a: &Camera, b: &Camera) -> f64 {
    let ratio = (a.mean_focal_px() / b.mean_focal_px()).ln().abs();
    if ratio.is_nan() { f64::INFINITY } else { ratio }
}

/// A seed that depends on the images of the pair and not on its place in the list.
fn pair_seed(graph: &ViewGraph, pair: &Pair, seed: u64) -> u64 {
    let ids = (u64::from(graph.images[pair.image1].id) << 32) | u64::from(graph.images[pair.image2].id);
    seed ^ ids.wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

#[cfg(test)]
mod tests;
