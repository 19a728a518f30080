//! A second try for pairs of images of whose matches few became points, with a wider bound.

use super::cluster::Cluster;
use super::create::Creator;
use crate::component::Component;
use crate::correspondences::CorrespondenceGraph;

/// For every image of the view graph the later images, ascending, with which too few matches became common points.
pub(super) struct WeakPairs {
    partners: Vec<Vec<u32>>,
}

impl WeakPairs {
    /// Pairs of posed images of whose matches less than `min_ratio` lead to one and the same point at both ends.
    pub(super) fn new(correspondences: &CorrespondenceGraph, component: &Component, min_ratio: f64) -> Self {
        let num_images = component.graph_image.iter().max().map_or(0, |&last| last + 1);
        let mut point_of_slot = vec![u32::MAX; correspondences.num_slots()];
        for (p, point) in component.reconstruction.points.iter().enumerate() {
            for o in &point.observations {
                let graph_image = component.graph_image[o.image as usize];
                if let Some(slot) = correspondences.slot(graph_image, o.keypoint) {
                    point_of_slot[slot as usize] = p as u32;
                }
            }
        }
        let mut posed = vec![false; num_images];
        for &graph_image in &component.graph_image {
            posed[graph_image] = true;
        }
        // Per image: (partner, matches in all, matches with a common point), sorted by partner.
        let mut counts: Vec<Vec<(u32, u32, u32)>> = vec![Vec::new(); num_images];
        let is_posed = |image: usize| posed.get(image) == Some(&true);
        for slot in 0..correspondences.num_slots() as u32 {
            let image = correspondences.image_of(slot);
            for &other in correspondences.matches_of(slot) {
                let partner = correspondences.image_of(other);
                if partner <= image || !is_posed(image) || !is_posed(partner) {
                    continue;
                }
                let partner = partner as u32;
                let of_image = &mut counts[image];
                let at = of_image.partition_point(|&(p, ..)| p < partner);
                if of_image.get(at).is_none_or(|&(p, ..)| p != partner) {
                    of_image.insert(at, (partner, 0, 0));
                }
                of_image[at].1 += 1;
                let point = point_of_slot[slot as usize];
                of_image[at].2 += u32::from(point != u32::MAX && point == point_of_slot[other as usize]);
            }
        }
        let weak = |&(_, all, common): &(u32, u32, u32)| f64::from(common) < min_ratio * f64::from(all);
        let partners = counts.iter().map(|c| c.iter().filter(|c| weak(c)).map(|c| c.0).collect()).collect();
        Self { partners }
    }

    /// Number of such pairs.
    pub(super) fn len(&self) -> usize {
        self.partners.iter().map(Vec::len).sum()
    }

    /// Whether a match of the cluster lies in such a pair.
    pub(super) fn touch(&self, cluster: &Cluster<'_>) -> bool {
        let of = |slot: u32| cluster.correspondences.image_of(slot);
        cluster.slots().any(|a| {
            let partners = self.partners.get(of(a)).filter(|p| !p.is_empty());
            partners.is_some() && cluster.correspondences.matches_of(a).iter().any(|&b| self.contains(of(a), of(b)))
        })
    }

    fn contains(&self, image1: usize, image2: usize) -> bool {
        self.partners.get(image1).is_some_and(|p| p.binary_search(&(image2 as u32)).is_ok())
    }
}

/// Continues and creates along every match of a weak pair (COLMAP's `Retriangulate`). The wider bound (as squared sine)
/// is for continuing only: points made under it would drift. Returns the number of new observations.
pub(super) fn retriangulate(
    cluster: &mut Cluster<'_>,
    creator: &mut Creator,
    pairs: &WeakPairs,
    max_sine2: f64,
) -> usize {
    let correspondences = cluster.correspondences;
    let mut added = 0;
    for a in cluster.slots() {
        for &b in correspondences.matches_of(a) {
            if b < a || !pairs.contains(correspondences.image_of(a), correspondences.image_of(b)) {
                continue;
            }
            added += match (cluster.is_free(a), cluster.is_free(b)) {
                (true, true) => creator.create_from_pair(cluster, a, b),
                (true, false) => usize::from(creator.continue_point(cluster, a, &[b], max_sine2)),
                (false, true) => usize::from(creator.continue_point(cluster, b, &[a], max_sine2)),
                (false, false) => 0,
            };
        }
    }
    added
}
