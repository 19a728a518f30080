//! The rules by which tracks are kept, dropped and chosen.

use std::sync::Arc;

use epipole_scene::{Pair, PairConfig, ViewImage};

use epipole_optimize::executor::block_on;

use super::*;
use crate::event::Silent;

/// Images whose keypoint `k` lies at (100 k, 0) px.
fn graph(num_images: usize, num_keypoints: usize, matches: &[(usize, usize, &[[u32; 2]])]) -> ViewGraph {
    let keypoints: Arc<[DVec2]> = (0..num_keypoints).map(|k| DVec2::new(100.0 * k as f64, 0.0)).collect();
    let image = |i: usize| ViewImage {
        id: i as u32 + 1,
        name: format!("{i}"),
        camera: 0,
        keypoints_px: keypoints.clone(),
        depths: None,
    };
    let pair = |&(image1, image2, inliers): &(usize, usize, &[[u32; 2]])| Pair {
        config: PairConfig::Calibrated,
        inliers: inliers.to_vec(),
        num_matches: inliers.len(),
        ..Pair::unverified(image1, image2)
    };
    ViewGraph {
        cameras: Vec::new(),
        images: (0..num_images).map(image).collect(),
        pairs: matches.iter().map(pair).collect(),
    }
}

fn tracks(graph: &ViewGraph, options: &Options) -> Vec<Vec<(u32, u32)>> {
    let component = vec![true; graph.images.len()];
    let all = vec![true; graph.pairs.len()];
    let tracks = block_on(run(graph, &component, &all, options, &mut Silent)).unwrap();
    let of = |t| tracks.observations_of(t).iter().map(|o| (o.image, o.keypoint)).collect();
    (0..tracks.len()).map(of).collect()
}

#[test]
fn three_images_make_a_track_and_two_do_not() {
    let graph = graph(3, 4, &[(0, 1, &[[0, 1], [2, 2]]), (1, 2, &[[1, 3]])]);
    assert_eq!(tracks(&graph, &Options::default()), [[(0, 0), (1, 1), (2, 3)]]);
    let two = Options { min_images: 2, ..Options::default() };
    assert_eq!(tracks(&graph, &two), [vec![(0, 0), (1, 1), (2, 3)], vec![(0, 2), (1, 2)]]);
}

#[test]
fn a_conflict_drops_the_whole_set_or_splits_it() {
    // Keypoint 0 everywhere is one point, keypoint 1 another; image 3 confuses them in a weak pair.
    let strong: &[[u32; 2]] = &[[0, 0], [1, 1]];
    let mut graph = graph(4, 2, &[(0, 1, strong), (0, 2, strong), (1, 2, strong), (2, 3, strong), (0, 3, &[[0, 1]])]);
    let dropped = tracks(&graph, &Options::default());
    assert!(dropped.is_empty());
    let splitting = Options { conflicts: Conflicts::Split, ..Options::default() };
    let all = |k: u32| (0..4).map(|i| (i, k)).collect::<Vec<_>>();
    assert_eq!(tracks(&graph, &splitting), [all(0), all(1)]);
    // Automatic: dropped while nobody misses it, taken apart where an image would be left with too little.
    assert_eq!(Options::default().conflicts, Conflicts::Auto);
    assert_eq!(tracks(&graph, &Options { starved_below: 2, ..Options::default() }), [all(0), all(1)]);
    assert!(tracks(&graph, &Options { starved_below: 3, ..Options::default() }).is_empty());
    // Close keypoints are no conflict: both stay in the track.
    for image in &mut graph.images {
        image.keypoints_px = Arc::from([DVec2::ZERO, DVec2::new(6.0, 8.0)]);
    }
    assert_eq!(tracks(&graph, &Options::default()).concat().len(), 8);
    for image in &mut graph.images {
        image.keypoints_px = Arc::from([DVec2::ZERO, DVec2::new(8.0, 8.0)]);
    }
    assert!(tracks(&graph, &Options::default()).is_empty());
}

#[test]
fn only_kept_pairs_of_the_component_count() {
    let graph = graph(4, 1, &[(0, 1, &[[0, 0]]), (1, 2, &[[0, 0]]), (2, 3, &[[0, 0]]), (0, 3, &[[0, 7]])]);
    let with = |component: &[bool], kept: &[bool]| {
        block_on(run(&graph, component, kept, &Options::default(), &mut Silent)).unwrap().observations.len()
    };
    assert_eq!(with(&[true; 4], &[true; 4]), 4);
    assert_eq!(with(&[true, true, true, false], &[true; 4]), 3);
    assert_eq!(with(&[true; 4], &[true, false, true, true]), 0);
}

#[test]
fn the_longest_tracks_are_kept() {
    let long: &[[u32; 2]] = &[[0, 0], [1, 1], [2, 2]];
    let graph = graph(4, 3, &[(0, 1, long), (1, 2, long), (2, 3, &[[1, 1]])]);
    let lengths = |options: &Options| tracks(&graph, options).iter().map(Vec::len).collect::<Vec<_>>();
    assert_eq!(lengths(&Options::default()), [3, 4, 3]);
    assert_eq!(lengths(&Options { max_tracks: Some(2), ..Options::default() }), [3, 4]);
    assert_eq!(lengths(&Options { max_observations: 6, ..Options::default() }), [4]);
    assert_eq!(lengths(&Options { required_tracks_per_view: Some(1), ..Options::default() }), [4]);
    assert_eq!(lengths(&Options { required_tracks_per_view: Some(2), ..Options::default() }), [3, 4]);
}
