//! New points from matched keypoints, and keypoints that continue an existing point.

use epipole_geometry::triangulation::{RobustOptions, View, estimate_triangulation, refine_point};

use super::cluster::Cluster;

/// Fewest rejected keypoints that are tried again as a point of their own (COLMAP: 3).
const MIN_RECURSION: usize = 3;
/// Gauss–Newton steps on the angular error of a new point; from the linear solution two or three reach rounding.
const REFINE_STEPS: usize = 3;

/// Viewing rays of a cluster's slots, and bounds on what they may found.
pub(super) struct Creator {
    /// By slot within the cluster; `None` where the slot takes no part.
    views: Vec<Option<View>>,
    first_slot: u32,
    robust: RobustOptions,
    ignore_two_view_tracks: bool,
    seed: u64,
    /// Kept between calls only to save allocations.
    gathered: Vec<u32>,
    gathered_views: Vec<View>,
}

impl Creator {
    /// Computes the rays of all slots of the cluster.
    pub(super) fn new(cluster: &Cluster<'_>, options: &super::Options, seed: u64) -> Self {
        Self {
            views: cluster.slots().map(|slot| cluster.views.view(slot)).collect(),
            first_slot: cluster.slots().start,
            robust: RobustOptions {
                min_angle_rad: options.min_angle_deg.to_radians(),
                max_angular_error_rad: options.create_max_angle_error_deg.to_radians(),
                ..RobustOptions::default()
            },
            ignore_two_view_tracks: options.ignore_two_view_tracks,
            seed,
            gathered: Vec::new(),
            gathered_views: Vec::new(),
        }
    }

    fn view(&self, slot: u32) -> Option<&View> {
        self.views[(slot - self.first_slot) as usize].as_ref()
    }

    /// Continues and creates around one slot, with all its matches: COLMAP's `TriangulateImage` for one feature.
    /// Returns the number of new observations.
    pub(super) fn triangulate(&mut self, cluster: &mut Cluster<'_>, slot: u32, max_sine2: f64) -> usize {
        if self.view(slot).is_none() {
            return 0;
        }
        let matches = cluster.correspondences.matches_of(slot);
        let continued = usize::from(self.continue_point(cluster, slot, matches, max_sine2));
        self.gathered.clear();
        for &matched in matches {
            if self.view(matched).is_some() {
                self.gathered.push(matched);
            }
        }
        self.gathered.push(slot);
        continued + self.create_from_gathered(cluster)
    }

    /// Attaches a free slot to the point of one of `others` that its ray passes closest to, if close enough.
    /// `max_sine2` is the squared sine of the angular bound.
    pub(super) fn continue_point(&self, cluster: &mut Cluster<'_>, slot: u32, others: &[u32], max_sine2: f64) -> bool {
        let Some(view) = self.view(slot).filter(|_| cluster.is_free(slot)) else { return false };
        let mut best: Option<(f64, usize)> = None;
        for point in others.iter().filter_map(|&other| cluster.point_of(other)) {
            let error = view.sine_squared(cluster.point(point).position);
            if error <= max_sine2 && best.is_none_or(|(least, _)| error < least) {
                best = Some((error, point));
            }
        }
        if let Some((_, point)) = best {
            cluster.attach(point, slot);
        }
        best.is_some()
    }

    /// Makes points of a pair of matched slots; for pairs of images with few common points.
    pub(super) fn create_from_pair(&mut self, cluster: &mut Cluster<'_>, a: u32, b: u32) -> usize {
        if self.view(a).is_none() || self.view(b).is_none() {
            return 0;
        }
        self.gathered.clear();
        self.gathered.extend([a, b]);
        self.create_from_gathered(cluster)
    }

    /// Makes points of the free ones of the gathered slots: the best one, then of what does not agree with it, while at
    /// least [`MIN_RECURSION`] are left. Returns the number of new observations.
    fn create_from_gathered(&mut self, cluster: &mut Cluster<'_>) -> usize {
        let mut created = 0;
        self.gathered.retain(|&slot| cluster.is_free(slot));
        loop {
            let Some(&first) = self.gathered.first().filter(|_| self.gathered.len() >= 2) else { return created };
            if self.ignore_two_view_tracks && self.gathered.len() == 2 && cluster.correspondences.is_two_view(first) {
                return created;
            }
            self.gathered_views.clear();
            let views = &self.views;
            self.gathered_views
                .extend(self.gathered.iter().filter_map(|slot| views[(slot - self.first_slot) as usize]));
            // Every call draws from its own stream, named by the slots it starts from: no dependence on the order of
            // work between clusters.
            let seed = self.seed ^ (u64::from(first) << 20) ^ self.gathered.len() as u64;
            let Some(found) = estimate_triangulation(&self.gathered_views, &self.robust, seed) else { return created };
            let mut inlier = found.inlier_mask.iter();
            self.gathered_views.retain(|_| inlier.next() == Some(&true));
            let position = refine_point(&self.gathered_views, found.position, REFINE_STEPS);
            let mut inlier = found.inlier_mask.iter();
            let (track, rest) = self.gathered.iter().partition(|_| inlier.next() == Some(&true));
            self.gathered = rest;
            let track: Vec<u32> = track;
            created += track.len();
            cluster.add_point(position, track);
            if self.gathered.len() < MIN_RECURSION {
                return created;
            }
        }
    }
}
