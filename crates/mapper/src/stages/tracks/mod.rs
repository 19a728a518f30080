//! Tracks: which keypoints of which images are one point of the scene, from the matches of all kept pairs.
//!
//! Union–find over the verified matches (algorithms.md §2.6). A set in which one image holds two keypoints far apart
//! contains a wrong match somewhere; COLMAP drops it whole, [`Conflicts::Split`] takes it apart instead.

mod split;

use epipole_scene::{Observation, ViewGraph};
use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::rotation::spanning_tree::DisjointSets;
use crate::error::MapperError;
use crate::event::{Observer, breath};

/// What happens to a set of matched keypoints that cannot be one point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Conflicts {
    /// It is dropped, as COLMAP does.
    Drop,
    /// It is taken apart, its strongest pairs joined first.
    Split,
    /// Dropped, unless that starves an image: where points are seen by dozens of images, one wrong match in a hundred is
    /// enough to drop nearly all of them, while elsewhere the tracks taken apart only cost time.
    #[default]
    Auto,
}

/// How tracks are built and how many are kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Two keypoints of one image further apart than this cannot be one point, px.
    pub max_intra_image_distance_px: f64,
    /// Fewest different images of a track.
    pub min_images: usize,
    /// What happens to sets with a conflict.
    pub conflicts: Conflicts,
    /// With [`Conflicts::Auto`], an image with fewer observations while conflicts hold more of it is starved.
    pub starved_below: usize,
    /// Tracks are taken longest first, and one is passed over once all its images have this many; `None` takes all.
    pub required_tracks_per_view: Option<usize>,
    /// Most tracks, longest first; `None` for no limit.
    pub max_tracks: Option<usize>,
    /// Most observations of all tracks: what caps the memory of positioning and bundle adjustment, longest first.
    pub max_observations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            // COLMAP's `intra_image_consistency_threshold` (algorithms.md §2.6).
            max_intra_image_distance_px: 10.0,
            // Two views of a point say nothing about the cameras' scale; GLOMAP's and COLMAP's number.
            min_images: 3,
            // On the real scenes splitting changes no AUC by more than 0.05: retriangulation recovers what was dropped.
            conflicts: Conflicts::Auto,
            // Fewer observations say little about a camera (global-positioning.md §5 judges none with less).
            starved_below: 30,
            required_tracks_per_view: None,
            max_tracks: None,
            // A safety net, not a measured bound: at an estimated 200 bytes an observation, 16 GB.
            max_observations: 80_000_000,
        }
    }
}

/// Tracks, one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    /// The observations of track `t` are `start[t]..start[t + 1]`; one entry more than there are tracks.
    pub start: Vec<u32>,
    /// Observations, ascending inside a track; `image` is an index into [`ViewGraph::images`].
    pub observations: Vec<Observation>,
    /// Sets of matched keypoints that were dropped (or taken apart) for a conflict.
    pub num_conflicts: usize,
}

impl Tracks {
    /// Number of tracks.
    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Whether there is no track.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The observations of a track.
    ///
    /// # Panics
    /// If `track` is not below [`Self::len`].
    pub fn observations_of(&self, track: usize) -> &[Observation] {
        &self.observations[self.start[track] as usize..self.start[track + 1] as usize]
    }

    fn push(&mut self, observations: impl Iterator<Item = Observation>) {
        self.observations.extend(observations);
        self.start.push(self.observations.len() as u32);
    }
}

/// Builds the tracks of the images that `in_component` marks from the verified matches of the pairs that `kept_pairs`
/// marks; matches that point past an image's keypoints are ignored.
///
/// # Errors
/// [`MapperError::InvalidOption`] when there are more keypoints than an index can count.
pub async fn run(
    graph: &ViewGraph,
    in_component: &[bool],
    kept_pairs: &[bool],
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Tracks, MapperError> {
    let keypoints = KeypointTable::new(graph, in_component)?;
    let pairs: Vec<usize> = (0..graph.pairs.len())
        .filter(|&p| kept_pairs[p] && in_component[graph.pairs[p].image1] && in_component[graph.pairs[p].image2])
        .collect();
    let mut sets = DisjointSets::new(keypoints.len());
    for &p in &pairs {
        for (a, b) in keypoints.matches(graph, p) {
            sets.join(a, b);
        }
        breath(observer).await;
    }
    let (start, members) = group(&mut sets, keypoints.len());
    breath(observer).await;
    let consistent = |set: &[u32]| keypoints.is_consistent(set, options.max_intra_image_distance_px);

    let mut tracks = Tracks { start: vec![0], ..Tracks::default() };
    let mut conflicting = Vec::new();
    for set in start.windows(2).map(|w| &members[w[0] as usize..w[1] as usize]) {
        if set.len() < options.min_images.max(2) {
            continue;
        }
        if !consistent(set) {
            tracks.num_conflicts += 1;
            conflicting.extend_from_slice(set);
        } else if keypoints.num_images(set) >= options.min_images {
            tracks.push(set.iter().map(|&k| keypoints.observation(k)));
        }
    }
    breath(observer).await;
    let split = match options.conflicts {
        Conflicts::Drop => false,
        Conflicts::Split => true,
        Conflicts::Auto => keypoints.starves(&tracks, &conflicting, options.starved_below),
    };
    if split {
        conflicting.sort_unstable();
        for set in split::split(graph, &keypoints, &pairs, &conflicting, options.max_intra_image_distance_px) {
            if keypoints.num_images(&set) >= options.min_images {
                tracks.push(set.iter().map(|&k| keypoints.observation(k)));
            }
        }
    }
    Ok(subsample(tracks, graph.images.len(), options))
}

/// The elements of every set, set by set; sets in the order of their first element, elements ascending.
fn group(sets: &mut DisjointSets, num_elements: usize) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; num_elements + 1];
    for element in 0..num_elements {
        start[sets.find(element) + 1] += 1;
    }
    for root in 0..num_elements {
        start[root + 1] += start[root];
    }
    let mut next = start.clone();
    let mut members = vec![0; num_elements];
    for element in 0..num_elements {
        let slot = &mut next[sets.find(element)];
        members[*slot as usize] = element as u32;
        *slot += 1;
    }
    (start, members)
}

/// All keypoints of the component's images under one number each, image by image.
struct KeypointTable<'a> {
    graph: &'a ViewGraph,
    /// First number of each image; images outside the component have none.
    first: Vec<u32>,
    image: Vec<u32>,
}

impl<'a> KeypointTable<'a> {
    /// Whether an image has fewer than `bound` observations in the tracks and conflicting keypoints to make up for it.
    fn starves(&self, tracks: &Tracks, conflicting: &[u32], bound: usize) -> bool {
        let mut observed = vec![0usize; self.graph.images.len()];
        for observation in &tracks.observations {
            observed[observation.image as usize] += 1;
        }
        let mut lost = vec![0usize; self.graph.images.len()];
        for &keypoint in conflicting {
            lost[self.image[keypoint as usize] as usize] += 1;
        }
        observed.iter().zip(lost).any(|(&observed, lost)| observed < bound && lost >= bound)
    }

    fn new(graph: &'a ViewGraph, in_component: &[bool]) -> Result<Self, MapperError> {
        let count = |i: usize| if in_component[i] { graph.images[i].keypoints_px.len() } else { 0 };
        let total: usize = (0..graph.images.len()).map(count).sum();
        if total > u32::MAX as usize {
            return Err(MapperError::InvalidOption {
                name: "keypoints".into(),
                value: total.to_string(),
                expected: "at most 4294967295 keypoints in one component; extract fewer per image".into(),
            });
        }
        let mut table = Self { graph, first: Vec::with_capacity(graph.images.len()), image: Vec::with_capacity(total) };
        for image in 0..graph.images.len() {
            table.first.push(table.image.len() as u32);
            table.image.resize(table.image.len() + count(image), image as u32);
        }
        Ok(table)
    }

    fn len(&self) -> usize {
        self.image.len()
    }

    fn observation(&self, number: u32) -> Observation {
        let image = self.image[number as usize];
        Observation { image, keypoint: number - self.first[image as usize] }
    }

    fn position_px(&self, number: u32) -> DVec2 {
        let o = self.observation(number);
        self.graph.images[o.image as usize].keypoints_px[o.keypoint as usize]
    }

    /// The verified matches of a pair of two images of the component, as keypoint numbers.
    fn matches(&self, graph: &'a ViewGraph, pair: usize) -> impl Iterator<Item = (usize, usize)> {
        let pair = &graph.pairs[pair];
        let len = [pair.image1, pair.image2].map(|i| graph.images[i].keypoints_px.len());
        let first = [self.first[pair.image1] as usize, self.first[pair.image2] as usize];
        let inside = move |&&[a, b]: &&[u32; 2]| (a as usize) < len[0] && (b as usize) < len[1];
        pair.inliers.iter().filter(inside).map(move |&[a, b]| (first[0] + a as usize, first[1] + b as usize))
    }

    fn num_images(&self, set: &[u32]) -> usize {
        set.chunk_by(|&a, &b| self.image[a as usize] == self.image[b as usize]).count()
    }

    /// Whether no image holds two keypoints of the (ascending) set further apart than the distance.
    fn is_consistent(&self, set: &[u32], max_distance_px: f64) -> bool {
        set.chunk_by(|&a, &b| self.image[a as usize] == self.image[b as usize]).all(|of_image| {
            // Usually one. A box wider than the distance settles most of the rest without looking at all pairs.
            let Some((&first, others)) = of_image.split_first().filter(|(_, others)| !others.is_empty()) else {
                return true;
            };
            let (mut low, mut high) = (self.position_px(first), self.position_px(first));
            for &k in others {
                low = low.min(self.position_px(k));
                high = high.max(self.position_px(k));
            }
            if (high - low).max_element() > max_distance_px {
                return false;
            }
            let close = |&a: &u32, &b: &u32| self.position_px(a).distance(self.position_px(b)) <= max_distance_px;
            of_image.iter().enumerate().all(|(i, a)| of_image[..i].iter().all(|b| close(a, b)))
        })
    }
}

/// Keeps the longest tracks that the limits allow; their order stays.
fn subsample(tracks: Tracks, num_images: usize, options: &Options) -> Tracks {
    let max_tracks = options.max_tracks.unwrap_or(usize::MAX);
    let fits = tracks.len() <= max_tracks && tracks.observations.len() <= options.max_observations;
    if fits && options.required_tracks_per_view.is_none() {
        return tracks;
    }
    let required = options.required_tracks_per_view.unwrap_or(usize::MAX);
    let mut order: Vec<usize> = (0..tracks.len()).collect();
    order.sort_by_key(|&t| (std::cmp::Reverse(tracks.observations_of(t).len()), t));
    let mut tracks_of_image = vec![0usize; num_images];
    let (mut chosen, mut num_observations) = (Vec::new(), 0);
    for t in order {
        let observations = tracks.observations_of(t);
        let wanted = observations.iter().any(|o| tracks_of_image[o.image as usize] < required);
        if chosen.len() == max_tracks || num_observations + observations.len() > options.max_observations {
            break;
        }
        if wanted {
            for of_image in observations.chunk_by(|a, b| a.image == b.image) {
                tracks_of_image[of_image[0].image as usize] += 1;
            }
            num_observations += observations.len();
            chosen.push(t);
        }
    }
    chosen.sort_unstable();
    let mut kept = Tracks { start: vec![0], observations: Vec::new(), num_conflicts: tracks.num_conflicts };
    for t in chosen {
        kept.push(tracks.observations_of(t).iter().copied());
    }
    kept
}

#[cfg(test)]
mod tests;
