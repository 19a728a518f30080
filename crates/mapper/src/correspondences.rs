//! Which keypoint was matched with which, over all pairs at once: the graph that retriangulation walks.
//!
//! Flat arrays in the manner of a compressed sparse row matrix, numbered so that every connected component is one
//! contiguous range: components never exchange a track, so each can be worked on alone and in parallel.

use std::ops::Range;

use epipole_scene::ViewGraph;

/// Marks a keypoint without any match.
const NO_SLOT: u32 = u32::MAX;

/// The matches of all usable pairs as an undirected graph over keypoints.
///
/// A *slot* is a keypoint with at least one match; a *cluster* is a connected component of slots. Slots are numbered
/// cluster by cluster (clusters by their first keypoint), within a cluster by image, then keypoint.
#[derive(Clone, Debug, Default)]
pub struct CorrespondenceGraph {
    /// Images + 1: keypoint `k` of image `i` has index `keypoint_start[i] + k` in `slot_of_keypoint`.
    keypoint_start: Vec<u32>,
    /// The slot of every keypoint, or [`NO_SLOT`].
    slot_of_keypoint: Vec<u32>,
    /// The image (index into [`ViewGraph::images`]) of every slot.
    image: Vec<u32>,
    /// The keypoint of every slot within its image.
    keypoint: Vec<u32>,
    /// Slots + 1: the matches of slot `s` are `matched[match_start[s]..match_start[s + 1]]`.
    match_start: Vec<u32>,
    /// Matched slots, ascending within a slot, each once.
    matched: Vec<u32>,
    /// Clusters + 1: first slot of every cluster.
    cluster_start: Vec<u32>,
}

impl CorrespondenceGraph {
    /// Gathers the verified matches of the pairs whose entry in `usable_pairs` is true (one entry per
    /// [`ViewGraph::pairs`]; pairs without an entry are left out). Matches that name a keypoint which does not
    /// exist are left out too.
    pub fn new(graph: &ViewGraph, usable_pairs: &[bool]) -> Self {
        let mut keypoint_start = vec![0u32];
        let mut total = 0usize;
        for image in &graph.images {
            total += image.keypoints_px.len();
            keypoint_start.push(index32(total));
        }
        let edges = || {
            let used = graph.pairs.iter().zip(usable_pairs).filter(|(_, usable)| **usable).map(|(pair, _)| pair);
            used.flat_map(|pair| {
                let (start1, start2) = (keypoint_start[pair.image1], keypoint_start[pair.image2]);
                let (end1, end2) = (keypoint_start[pair.image1 + 1], keypoint_start[pair.image2 + 1]);
                pair.inliers.iter().filter_map(move |&[k1, k2]| {
                    let ends = (start1.checked_add(k1)?, start2.checked_add(k2)?);
                    (ends.0 < end1 && ends.1 < end2 && ends.0 != ends.1).then_some(ends)
                })
            })
        };

        let mut parent: Vec<u32> = (0..index32(total)).collect();
        let mut degree = vec![0u32; total];
        for (a, b) in edges() {
            degree[a as usize] += 1;
            degree[b as usize] += 1;
            // The smaller root wins, so a cluster's root is its first keypoint whatever the order of the pairs.
            let (a, b) = (find(&mut parent, a), find(&mut parent, b));
            parent[a.max(b) as usize] = a.min(b);
        }

        // Counting sort of the matched keypoints by cluster; `slot_of_keypoint` first holds cluster sizes at the roots.
        let mut slot_of_keypoint = vec![0u32; total];
        for k in 0..index32(total) {
            if degree[k as usize] > 0 {
                let root = find(&mut parent, k);
                slot_of_keypoint[root as usize] += 1;
            }
        }
        let mut cluster_start = vec![0u32];
        let mut slots = 0u32;
        for size in &mut slot_of_keypoint {
            if *size > 0 {
                let first = slots;
                slots += *size;
                cluster_start.push(slots);
                *size = first;
            }
        }
        let mut next = slot_of_keypoint.clone();
        let mut image = vec![0u32; slots as usize];
        let mut keypoint = vec![0u32; slots as usize];
        let mut match_start = vec![0u32; slots as usize + 1];
        for i in 0..graph.images.len() {
            for k in keypoint_start[i]..keypoint_start[i + 1] {
                if degree[k as usize] == 0 {
                    slot_of_keypoint[k as usize] = NO_SLOT;
                    continue;
                }
                let root = find(&mut parent, k) as usize;
                let slot = next[root];
                next[root] += 1;
                slot_of_keypoint[k as usize] = slot;
                image[slot as usize] = i as u32;
                keypoint[slot as usize] = k - keypoint_start[i];
                match_start[slot as usize + 1] = degree[k as usize];
            }
        }
        drop((parent, degree, next));

        let mut sum = 0usize;
        for start in &mut match_start {
            sum += *start as usize;
            *start = index32(sum);
        }
        let mut fill = match_start.clone();
        let mut matched = vec![0u32; sum];
        for (a, b) in edges() {
            let (a, b) = (slot_of_keypoint[a as usize], slot_of_keypoint[b as usize]);
            for (from, to) in [(a, b), (b, a)] {
                matched[fill[from as usize] as usize] = to;
                fill[from as usize] += 1;
            }
        }
        let mut made = Self { keypoint_start, slot_of_keypoint, image, keypoint, match_start, matched, cluster_start };
        made.sort_and_unify();
        made
    }

    /// Sorts every slot's matches and drops repeated ones (a database may list a match twice).
    fn sort_and_unify(&mut self) {
        let mut kept = 0usize;
        let mut from = 0usize;
        for slot in 0..self.num_slots() {
            let to = self.match_start[slot + 1] as usize;
            self.matched[from..to].sort_unstable();
            let first = kept;
            for i in from..to {
                let other = self.matched[i];
                if kept == first || self.matched[kept - 1] != other {
                    self.matched[kept] = other;
                    kept += 1;
                }
            }
            from = to;
            self.match_start[slot + 1] = kept as u32;
        }
        self.matched.truncate(kept);
    }

    /// Number of keypoints with a match.
    pub fn num_slots(&self) -> usize {
        self.image.len()
    }

    /// Number of connected components.
    pub fn num_clusters(&self) -> usize {
        self.cluster_start.len().saturating_sub(1)
    }

    /// Number of distinct matches.
    pub fn num_matches(&self) -> usize {
        self.matched.len() / 2
    }

    /// The slots of a connected component.
    pub fn cluster(&self, cluster: usize) -> Range<u32> {
        self.cluster_start[cluster]..self.cluster_start[cluster + 1]
    }

    /// The connected component of a slot.
    pub fn cluster_of(&self, slot: u32) -> usize {
        self.cluster_start.partition_point(|&start| start <= slot) - 1
    }

    /// The slots matched with a slot, ascending.
    pub fn matches_of(&self, slot: u32) -> &[u32] {
        let slot = slot as usize;
        &self.matched[self.match_start[slot] as usize..self.match_start[slot + 1] as usize]
    }

    /// The image of a slot, an index into [`ViewGraph::images`].
    pub fn image_of(&self, slot: u32) -> usize {
        self.image[slot as usize] as usize
    }

    /// The keypoint of a slot within its image.
    pub fn keypoint_of(&self, slot: u32) -> u32 {
        self.keypoint[slot as usize]
    }

    /// The slot of a keypoint, or `None` if it has no match or does not exist.
    pub fn slot(&self, image: usize, keypoint: u32) -> Option<u32> {
        let end = *self.keypoint_start.get(image + 1)?;
        let index = self.keypoint_start[image].checked_add(keypoint).filter(|&index| index < end)?;
        Some(self.slot_of_keypoint[index as usize]).filter(|&slot| slot != NO_SLOT)
    }

    /// Whether a slot and its only match are matched with nothing else: a track of it could never be longer than two.
    pub fn is_two_view(&self, slot: u32) -> bool {
        matches!(self.matches_of(slot), [other] if self.matches_of(*other).len() == 1)
    }
}

/// The root of a keypoint's set, halving the path to it.
fn find(parent: &mut [u32], mut k: u32) -> u32 {
    while parent[k as usize] != k {
        let grandparent = parent[parent[k as usize] as usize];
        parent[k as usize] = grandparent;
        k = grandparent;
    }
    k
}

fn index32(n: usize) -> u32 {
    u32::try_from(n).expect("four billion keypoints or matches would take more than 64 GB before they came here")
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use epipole_scene::{Pair, PairConfig, ViewImage};
    use glam::DVec2;

    use super::*;

    fn graph(keypoints: &[usize], pairs: &[(usize, usize, &[[u32; 2]])]) -> ViewGraph {
        ViewGraph {
            cameras: Vec::new(),
            images: keypoints
                .iter()
                .enumerate()
                .map(|(i, &n)| ViewImage {
                    id: i as u32 + 1,
                    name: format!("{i}.jpg"),
                    camera: 0,
                    keypoints_px: Arc::from(vec![DVec2::ZERO; n]),
                    depths: None,
                })
                .collect(),
            pairs: pairs
                .iter()
                .map(|&(image1, image2, inliers)| Pair {
                    config: PairConfig::Calibrated,
                    inliers: inliers.to_vec(),
                    num_matches: inliers.len(),
                    ..Pair::unverified(image1, image2)
                })
                .collect(),
        }
    }

    #[test]
    fn clusters_are_contiguous_and_every_match_is_listed_from_both_ends() {
        let graph = graph(
            &[4, 3, 3],
            &[(0, 1, &[[0, 2], [3, 0], [0, 2]]), (0, 2, &[[3, 1]]), (1, 2, &[[0, 1], [1, 0], [9, 0]])],
        );
        let c = CorrespondenceGraph::new(&graph, &[true; 3]);
        assert_eq!((c.num_slots(), c.num_clusters(), c.num_matches()), (7, 3, 5));
        let members = |k: usize| c.cluster(k).map(|s| (c.image_of(s), c.keypoint_of(s))).collect::<Vec<_>>();
        assert_eq!(members(0), [(0, 0), (1, 2)]);
        assert_eq!(members(1), [(0, 3), (1, 0), (2, 1)]);
        assert_eq!(members(2), [(1, 1), (2, 0)]);
        for slot in 0..c.num_slots() as u32 {
            assert_eq!(c.slot(c.image_of(slot), c.keypoint_of(slot)), Some(slot));
            assert!(c.cluster(c.cluster_of(slot)).contains(&slot));
            for &other in c.matches_of(slot) {
                assert!(c.matches_of(other).contains(&slot));
            }
        }
        assert!(c.is_two_view(c.slot(0, 0).unwrap()));
        assert!(!c.is_two_view(c.slot(0, 3).unwrap()));
        assert_eq!(c.slot(0, 1), None);
        assert_eq!(c.slot(0, 4), None);
        assert_eq!(c.slot(7, 0), None);
    }

    #[test]
    fn pairs_that_are_not_usable_do_not_connect() {
        let graph = graph(&[1, 1, 1], &[(0, 1, &[[0, 0]]), (1, 2, &[[0, 0]])]);
        let c = CorrespondenceGraph::new(&graph, &[true, false]);
        assert_eq!((c.num_slots(), c.num_clusters()), (2, 1));
        let empty = CorrespondenceGraph::new(&ViewGraph::default(), &[]);
        assert_eq!((empty.num_slots(), empty.num_clusters(), empty.num_matches()), (0, 0, 0));
    }
}
