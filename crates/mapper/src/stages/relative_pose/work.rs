//! The pairs of a graph on their way through the stage: which wait, and what was found for the others.

use epipole_geometry::camera::Camera;
use epipole_scene::{Pair, ViewGraph};
use glam::DVec2;

use super::problem::{Found, Problem, Task};
use super::{Options, focal_change};
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};
use crate::options::Matches;
use crate::parallel;

/// A batch is closed when it has reached this many numbers, a megabyte: some are under way for every helper.
const NUMBERS_PER_BATCH: usize = 1 << 17;

pub(super) struct Work<'a> {
    graph: &'a ViewGraph,
    options: &'a Options,
    matches: Matches,
    seed: u64,
    /// Pairs that have to be solved, the next one last.
    pub(super) waiting: Vec<usize>,
    /// One entry a pair; none for those that are not settled.
    pub(super) found: Vec<Option<Found>>,
    pub(super) settled: usize,
}

impl<'a> Work<'a> {
    pub(super) fn new(graph: &'a ViewGraph, options: &'a Options, matches: Matches, seed: u64) -> Self {
        let mut work = Self { graph, options, matches, seed, waiting: Vec::new(), found: Vec::new(), settled: 0 };
        work.found = graph.pairs.iter().map(|pair| work.known(pair)).collect();
        work.waiting = (0..graph.pairs.len()).rev().filter(|&pair| work.found[pair].is_none()).collect();
        work.settled = graph.pairs.len() - work.waiting.len();
        work
    }

    /// What needs no solving.
    fn known(&self, pair: &Pair) -> Option<Found> {
        let options = self.options;
        if let Some(raw) = raw_matches(pair, self.matches) {
            return (raw.len() < options.min_inliers_raw).then_some(Found::Weak);
        }
        if !pair.config.has_pose() || pair.inliers.len() < options.min_inliers {
            return Some(Found::Weak);
        }
        (options.use_stored && stored_pose_holds(self.graph, pair, options)).then_some(Found::Stored)
    }

    fn problem(&self, pair: usize) -> Problem {
        let (graph, options, pair) = (self.graph, self.options, &self.graph.pairs[pair]);
        let (image1, image2) = (&graph.images[pair.image1], &graph.images[pair.image2]);
        let (task, matrices, usable, fewest, total) = match raw_matches(pair, self.matches) {
            Some(raw) => {
                let task = Task::Raw { min_inliers: options.min_inliers };
                (task, [None; 3], existing(graph, pair, raw), options.min_inliers_raw, raw.len())
            }
            None => {
                let usable = thinned(existing(graph, pair, &pair.inliers), options.max_matches);
                let matrices = [pair.essential, pair.fundamental, pair.homography];
                let total = usable.len();
                (Task::Verified(pair.config), matrices, usable, options.min_inliers, total)
            }
        };
        let pixels =
            |keypoints_px: &[DVec2], side: usize| usable.iter().map(|m| keypoints_px[m[side] as usize]).collect();
        Problem {
            task,
            matrices,
            cameras: [image1, image2].map(|image| graph.cameras[image.camera].clone()),
            points_px: [pixels(&image1.keypoints_px, 0), pixels(&image2.keypoints_px, 1)],
            max_error_px: options.max_error_px,
            enough: (fewest as f64).max(options.min_inlier_ratio * total as f64),
            seed: pair_seed(graph, pair, self.seed),
        }
    }

    /// Takes up to so many pairs from what waits, with their problems in numbers; `None` where nothing waits.
    pub(super) fn batch(&mut self, most: usize) -> Option<(Vec<usize>, Vec<f64>)> {
        let (mut pairs, mut numbers) = (Vec::new(), Vec::new());
        while pairs.len() < most && numbers.len() < NUMBERS_PER_BATCH {
            let Some(pair) = self.waiting.pop() else { break };
            self.problem(pair).write(&mut numbers);
            pairs.push(pair);
        }
        (!pairs.is_empty()).then_some((pairs, numbers))
    }

    /// Solves what waits on this thread, or on all that rayon has, `at_once` pairs between two looks at what a person wants;
    /// until nothing waits or so many seconds are over.
    pub(super) async fn solve_here(
        &mut self,
        at_once: usize,
        seconds: f64,
        observer: &mut dyn Observer,
    ) -> Result<(), MapperError> {
        let start = observer.now_seconds();
        while !self.waiting.is_empty() && observer.now_seconds() - start < seconds {
            if observer.should_stop() {
                return Err(MapperError::Stopped);
            }
            let pairs = self.waiting.split_off(self.waiting.len().saturating_sub(at_once));
            let found = parallel::map(&pairs, |_, &pair| self.problem(pair).solve());
            self.settle(pairs, found);
            observer.event(&self.progress());
            breath(observer).await;
        }
        Ok(())
    }

    pub(super) fn settle(&mut self, pairs: Vec<usize>, found: Vec<Found>) {
        self.settled += pairs.len();
        for (pair, found) in pairs.into_iter().zip(found) {
            self.found[pair] = Some(found);
        }
    }

    pub(super) fn progress(&self) -> Event {
        Event::Progress { stage: Stage::RelativePose, done: self.settled, total: self.graph.pairs.len() }
    }
}

/// The raw matches of a pair, where they are what counts.
fn raw_matches(pair: &Pair, matches: Matches) -> Option<&[[u32; 2]]> {
    pair.matches.as_deref().filter(|_| matches == Matches::Raw)
}

/// The matches between keypoints that exist.
pub(super) fn existing(graph: &ViewGraph, pair: &Pair, matches: &[[u32; 2]]) -> Vec<[u32; 2]> {
    let [len1, len2] = [pair.image1, pair.image2].map(|image| graph.images[image].keypoints_px.len());
    matches.iter().filter(|&&[a, b]| (a as usize) < len1 && (b as usize) < len2).copied().collect()
}

/// At most `max` of the matches, evenly spread over their order.
fn thinned(matches: Vec<[u32; 2]>, max: usize) -> Vec<[u32; 2]> {
    if matches.len() <= max {
        return matches;
    }
    (0..max).map(|i| matches[i * matches.len() / max]).collect()
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

/// A seed that depends on the images of the pair and not on its place in the list.
fn pair_seed(graph: &ViewGraph, pair: &Pair, seed: u64) -> u64 {
    let ids = (u64::from(graph.images[pair.image1].id) << 32) | u64::from(graph.images[pair.image2].id);
    seed ^ ids.wrapping_mul(0x9e37_79b9_7f4a_7c15)
}
