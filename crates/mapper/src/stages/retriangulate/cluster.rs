//! The points of one cluster of the correspondence graph while they grow, and which keypoint belongs to which.
//!
//! No track leaves its cluster, so clusters are worked on in parallel, each by one thread in a fixed order: the result
//! does not depend on the number of threads.

use epipole_scene::Point;
use glam::DVec3;

use super::views::Views;
use crate::component::Component;
use crate::correspondences::CorrespondenceGraph;
use crate::event::{Observer, breath};
use crate::parallel;

/// Clusters handed to a thread at a time: most clusters have a handful of slots, too few to be a task.
const CLUSTERS_PER_TASK: usize = 64;

/// A slot that observes no point.
const FREE: u32 = u32::MAX;
/// A slot of a point that this stage cannot touch because its track spans clusters.
const TAKEN: u32 = u32::MAX - 1;

/// A point that grows.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    /// In the world.
    pub(super) position: DVec3,
    /// Slots that observe it; empty once it has been merged into another.
    pub(super) slots: Vec<u32>,
}

/// One connected component of the correspondence graph with its points.
pub(super) struct Cluster<'a> {
    pub(super) correspondences: &'a CorrespondenceGraph,
    pub(super) views: &'a Views<'a>,
    first_slot: u32,
    owner: Vec<u32>,
    points: Vec<Draft>,
}

impl<'a> Cluster<'a> {
    /// The slots of the cluster, in order.
    pub(super) fn slots(&self) -> std::ops::Range<u32> {
        self.first_slot..self.first_slot + self.owner.len() as u32
    }

    fn local(&self, slot: u32) -> usize {
        (slot - self.first_slot) as usize
    }

    /// Number of points ever made here, merged ones included.
    pub(super) fn num_points(&self) -> usize {
        self.points.len()
    }

    pub(super) fn point(&self, point: usize) -> &Draft {
        &self.points[point]
    }

    pub(super) fn set_position(&mut self, point: usize, position: DVec3) {
        self.points[point].position = position;
    }

    /// The point a slot observes.
    pub(super) fn point_of(&self, slot: u32) -> Option<usize> {
        let owner = self.owner[self.local(slot)];
        (owner < TAKEN).then_some(owner as usize)
    }

    /// Whether the slot observes nothing yet.
    pub(super) fn is_free(&self, slot: u32) -> bool {
        self.owner[self.local(slot)] == FREE
    }

    /// A new point seen by free slots.
    pub(super) fn add_point(&mut self, position: DVec3, slots: Vec<u32>) -> usize {
        let point = self.points.len();
        for &slot in &slots {
            let local = self.local(slot);
            self.owner[local] = point as u32;
        }
        self.points.push(Draft { position, slots });
        point
    }

    /// Lets a free slot observe a point.
    pub(super) fn attach(&mut self, point: usize, slot: u32) {
        let local = self.local(slot);
        self.owner[local] = point as u32;
        self.points[point].slots.push(slot);
    }

    /// Moves all observations of `from` to `into`, which lies at `position` from now on.
    pub(super) fn merge(&mut self, into: usize, from: usize, position: DVec3) {
        let moved = std::mem::take(&mut self.points[from].slots);
        for &slot in &moved {
            let local = self.local(slot);
            self.owner[local] = into as u32;
        }
        self.points[into].slots.extend(moved);
        self.points[into].position = position;
    }
}

/// Sorts the component's points into clusters, lets `work` change every cluster, and writes the points back:
/// ordered by cluster, tracks ascending, ids from 1. Returns what `work` returned, by cluster; asked to stop, it leaves
/// the last clusters as they were, and returns nothing of them.
///
/// Points that span clusters, or are seen from an image that takes no part, are kept as they are, first in order.
pub(super) async fn for_each<R: Send>(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    skip_bogus_cameras: bool,
    observer: &mut dyn Observer,
    work: impl Fn(&mut Cluster<'_>) -> R + Sync + Send,
) -> Vec<R> {
    let (kept, drafts, taken) = sort_into_clusters(correspondences, component, skip_bogus_cameras);
    breath(observer).await;
    let views = Views::new(correspondences, component, skip_bogus_cameras);
    breath(observer).await;
    let num_clusters = correspondences.num_clusters();
    let tasks: Vec<usize> = (0..num_clusters).step_by(CLUSTERS_PER_TASK).collect();
    let done = parallel::map_breathing(&tasks, observer, |_, &first| {
        let mut points = Vec::new();
        let mut returned = Vec::new();
        for c in first..(first + CLUSTERS_PER_TASK).min(num_clusters) {
            let slots = correspondences.cluster(c);
            let mut cluster = Cluster {
                correspondences,
                views: &views,
                first_slot: slots.start,
                owner: vec![FREE; slots.len()],
                points: Vec::new(),
            };
            let of_cluster = |slot: &&u32| slots.contains(slot);
            for slot in taken[taken.partition_point(|&s| s < slots.start)..].iter().take_while(of_cluster) {
                let local = cluster.local(*slot);
                cluster.owner[local] = TAKEN;
            }
            let from = drafts.partition_point(|(of, _)| *of < c);
            for (_, draft) in drafts[from..].iter().take_while(|(of, _)| *of == c) {
                cluster.add_point(draft.position, draft.slots.clone());
            }
            returned.push(work(&mut cluster));
            points.extend(cluster.points.iter().filter_map(|draft| finished(draft, &views)));
        }
        (points, returned)
    })
    .await;
    let mut points = kept;
    let reached = tasks.get(done.len()).copied().unwrap_or(num_clusters);
    let mut all_returned = Vec::with_capacity(num_clusters);
    for (of_task, returned) in done {
        points.extend(of_task);
        all_returned.extend(returned);
    }
    points.extend(drafts.iter().filter(|(of, _)| *of >= reached).filter_map(|(_, draft)| finished(draft, &views)));
    for (i, point) in points.iter_mut().enumerate() {
        point.id = i as u64 + 1;
    }
    component.reconstruction.points = points;
    breath(observer).await;
    all_returned
}

fn finished(draft: &Draft, views: &Views<'_>) -> Option<Point> {
    if draft.slots.is_empty() {
        return None;
    }
    let mut observations: Vec<_> = draft.slots.iter().filter_map(|&slot| views.observation(slot)).collect();
    observations.sort_unstable();
    Some(Point { id: 0, position: draft.position, rgb: [0; 3], error_px: -1.0, observations })
}

/// Takes the component's points out: those to keep as they are, the others by cluster, and the slots of the former.
fn sort_into_clusters(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    skip_bogus_cameras: bool,
) -> (Vec<Point>, Vec<(usize, Draft)>, Vec<u32>) {
    let points = std::mem::take(&mut component.reconstruction.points);
    let views = Views::new(correspondences, component, skip_bogus_cameras);
    let slots_of = |point: &Point| -> Vec<Option<u32>> {
        let of = |image: u32| component.graph_image[image as usize];
        point.observations.iter().map(|o| correspondences.slot(of(o.image), o.keypoint)).collect()
    };
    let drafts = parallel::map(&points, |_, point| {
        let slots: Option<Vec<u32>> = slots_of(point).into_iter().collect();
        let slots = slots?;
        let cluster = correspondences.cluster_of(*slots.first()?);
        let range = correspondences.cluster(cluster);
        let touchable = |slot: &u32| range.contains(slot) && views.has_image(correspondences.image_of(*slot));
        let all_touchable = slots.iter().all(touchable);
        all_touchable.then_some((cluster, Draft { position: point.position, slots }))
    });
    let mut kept = Vec::new();
    let mut taken = Vec::new();
    let mut of_clusters = Vec::new();
    for (point, draft) in points.into_iter().zip(drafts) {
        match draft {
            Some(draft) => of_clusters.push(draft),
            None => {
                taken.extend(slots_of(&point).into_iter().flatten());
                kept.push(point);
            }
        }
    }
    // Stable: points of one cluster stay in their order.
    of_clusters.sort_by_key(|(cluster, _)| *cluster);
    taken.sort_unstable();
    (kept, of_clusters, taken)
}
