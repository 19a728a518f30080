//! Triangulates everything anew from the matches once the poses are good: longer tracks, and more of them, than those
//! that global positioning started from.
//!
//! Semantics of COLMAP's incremental triangulator as its global mapper drives it (algorithms.md §2.10): create and
//! continue, complete, merge, a second try for weak pairs; then rounds of bundle adjustment, complete, merge and filter.
//! It differs in working cluster by cluster of the correspondence graph, which makes the passes parallel and their
//! result independent of the number of threads.

mod cluster;
mod complete;
mod create;
mod filter;
mod merge;
mod options;
mod polish;
#[cfg(test)]
mod scene_for_tests;
#[cfg(test)]
mod tests;
mod under_reconstructed;
mod views;

pub use filter::filter;
pub use options::Options;

use std::fmt;

use crate::component::Component;
use crate::correspondences::CorrespondenceGraph;
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};

use cluster::Cluster;
use create::Creator;
use under_reconstructed::WeakPairs;

/// What the stage did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Points before, which are deleted first.
    pub points_before: usize,
    /// Observations before.
    pub observations_before: usize,
    /// Observations that new points started with or that continued one.
    pub created: usize,
    /// Pairs of images that were tried a second time.
    pub weak_pairs: usize,
    /// Observations that the second try added.
    pub retried: usize,
    /// Observations that completed tracks, over all rounds.
    pub completed: usize,
    /// Observations of points that were merged of several, over all rounds.
    pub merged: usize,
    /// Observations that were filtered out, over all rounds.
    pub filtered: usize,
    /// Rounds of bundle adjustment.
    pub rounds: usize,
    /// Points at the end.
    pub points_after: usize,
    /// Observations at the end.
    pub observations_after: usize,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} points with {} observations (before: {}, {}) after {} rounds; {} observations completed tracks, {} filtered",
            self.points_after,
            self.observations_after,
            self.points_before,
            self.observations_before,
            self.rounds,
            self.completed,
            self.filtered
        )
    }
}

/// What [`complete_and_merge`] changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Grown {
    /// Observations added to tracks.
    pub completed: usize,
    /// Observations of points that were merged of several.
    pub merged: usize,
}

/// The whole stage: deletes the component's points, triangulates the matches of its images, then alternates `adjust`
/// (bundle adjustment, the caller's) with completing, merging and filtering until little changes.
///
/// The component keeps its images, also those that lose every observation. Asked to stop, it ends after the current pass.
pub async fn run(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    options: &Options,
    seed: u64,
    adjust: &mut impl AsyncFnMut(&mut Component, &mut dyn Observer) -> Result<(), MapperError>,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    let mut summary = Summary {
        points_before: component.reconstruction.points.len(),
        observations_before: component.reconstruction.num_observations(),
        ..Summary::default()
    };
    // Creating, growing and the second try are one unit of work, every round another.
    let total = options.rounds + 1;
    let progress = |observer: &mut dyn Observer, done: usize| {
        observer.event(&Event::Progress { stage: Stage::Retriangulate, done, total });
    };
    progress(observer, 0);
    summary.created = create_all(correspondences, component, options, seed, observer).await;
    let grow = async |component: &mut Component, summary: &mut Summary, observer: &mut dyn Observer| {
        let grown = complete_and_merge(correspondences, component, options, observer).await;
        summary.completed += grown.completed;
        summary.merged += grown.merged;
    };
    grow(component, &mut summary, observer).await;
    (summary.weak_pairs, summary.retried) = retry_weak_pairs(correspondences, component, options, seed, observer).await;
    progress(observer, 1);
    let mut before = component.reconstruction.num_observations();
    while summary.rounds < options.rounds && !observer.should_stop() {
        adjust(component, observer).await?;
        grow(component, &mut summary, observer).await;
        observer.snapshot(component, false);
        breath(observer).await;
        summary.filtered += filter(component, options.filter_max_error_px, options.filter_min_angle_deg);
        breath(observer).await;
        summary.rounds += 1;
        progress(observer, summary.rounds + 1);
        // Every round completes tracks with observations within 15 px and filters most of them again at 4 px: counting
        // both, as COLMAP does, would never settle. What counts is what stays.
        let after = component.reconstruction.num_observations();
        let settled = after.abs_diff(before) as f64 <= options.settled_share * before as f64;
        before = after;
        if settled {
            break;
        }
    }
    progress(observer, total);
    summary.points_after = component.reconstruction.points.len();
    summary.observations_after = component.reconstruction.num_observations();
    Ok(summary)
}

/// Replaces the component's points by new ones from the matches of its posed images: for every keypoint in the order of
/// images, joins the nearest point that a match leads to, and makes points of the keypoint and those of its matches
/// that observe none yet. Returns the number of observations; asked to stop halfway, it puts the old points back.
pub async fn create_all(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    options: &Options,
    seed: u64,
    observer: &mut dyn Observer,
) -> usize {
    let before = std::mem::take(&mut component.reconstruction.points);
    let max_sine2 = squared_sine(options.continue_max_angle_error_deg);
    let created = cluster::for_each(correspondences, component, options.skip_bogus_cameras, observer, |cluster| {
        let mut creator = Creator::new(cluster, options, seed);
        cluster.slots().map(|slot| creator.triangulate(cluster, slot, max_sine2)).sum()
    })
    .await;
    if created.len() < correspondences.num_clusters() {
        component.reconstruction.points = before;
        return 0;
    }
    created.iter().sum()
}

/// Completes all tracks, then merges points, then moves the points alone to where their grown tracks see them.
pub async fn complete_and_merge(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    options: &Options,
    observer: &mut dyn Observer,
) -> Grown {
    let grown = cluster::for_each(correspondences, component, options.skip_bogus_cameras, observer, |cluster| {
        let mut grown = Grown::default();
        for point in 0..cluster.num_points() {
            grown.completed +=
                complete::complete(cluster, point, options.complete_max_error_px, options.complete_max_transitivity);
        }
        for point in 0..cluster.num_points() {
            grown.merged += merge::merge(cluster, point, options.merge_max_error_px);
        }
        polish_all(cluster, options);
        grown
    })
    .await;
    grown.iter().fold(Grown::default(), |sum, g| Grown {
        completed: sum.completed + g.completed,
        merged: sum.merged + g.merged,
    })
}

/// Tries the matches of pairs again of whose matches few became points; returns the numbers of pairs and of new
/// observations.
pub async fn retry_weak_pairs(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    options: &Options,
    seed: u64,
    observer: &mut dyn Observer,
) -> (usize, usize) {
    let pairs = WeakPairs::new(correspondences, component, options.weak_pair_max_ratio);
    if pairs.len() == 0 {
        return (0, 0);
    }
    let max_sine2 = squared_sine(options.weak_pair_max_angle_error_deg);
    let added = cluster::for_each(correspondences, component, options.skip_bogus_cameras, observer, |cluster| {
        // Rays are costly, and most clusters have no such match.
        if !pairs.touch(cluster) {
            return 0;
        }
        let mut creator = Creator::new(cluster, options, seed);
        under_reconstructed::retriangulate(cluster, &mut creator, &pairs, max_sine2)
    })
    .await;
    (pairs.len(), added.iter().sum())
}

fn polish_all(cluster: &mut Cluster<'_>, options: &Options) {
    if options.polish_steps == 0 {
        return;
    }
    for point in 0..cluster.num_points() {
        if cluster.point(point).slots.len() >= 2 {
            polish::polish(cluster, point, options.polish_huber_px, options.polish_steps);
        }
    }
}

fn squared_sine(deg: f64) -> f64 {
    deg.to_radians().sin().powi(2)
}
