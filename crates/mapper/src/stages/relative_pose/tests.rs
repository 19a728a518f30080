//! Pairs with and without stored poses, weak pairs, stale poses, raw matches.

use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::CameraModel;
use epipole_optimize::executor::block_on;
use epipole_scene::{Pair, PairConfig, ViewImage};
use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};

use super::*;
use crate::event::Silent;

const NUM_POINTS: usize = 120;

/// Two or more images of a cloud of points, all pairs matched; the last `outliers` matches of a pair are shifted by one.
pub(super) fn graph(num_images: usize, outliers: usize) -> (ViewGraph, Vec<Rigid3>) {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(11);
    let mut uniform = |scale: f64| (2.0 * rng.random::<f64>() - 1.0) * scale;
    let camera = Camera {
        id: 1,
        model: CameraModel::SimplePinhole,
        width_px: 1000,
        height_px: 800,
        params: vec![900.0, 500.0, 400.0],
        has_prior_focal: true,
    };
    let points: Vec<DVec3> = (0..NUM_POINTS).map(|_| DVec3::new(uniform(1.0), uniform(1.0), uniform(1.0))).collect();
    let poses: Vec<Rigid3> = (0..num_images)
        .map(|i| {
            let turn = DQuat::from_rotation_y(0.25 * i as f64) * DQuat::from_rotation_x(uniform(0.2));
            Rigid3::new(turn, DVec3::new(uniform(0.3), uniform(0.3), 5.0 + uniform(0.5)))
        })
        .collect();
    let keypoints = |pose: &Rigid3| -> Arc<[DVec2]> {
        points.iter().map(|&p| camera.project(pose.transform_point(p)).unwrap() + DVec2::splat(0.1)).collect()
    };
    let images = poses.iter().enumerate().map(|(i, pose)| ViewImage {
        id: i as u32 + 1,
        name: format!("{i}"),
        camera: 0,
        keypoints_px: keypoints(pose),
        depths: None,
    });
    let images = images.collect();
    let matches: Vec<[u32; 2]> = (0..NUM_POINTS as u32)
        .map(|k| [k, if k as usize >= NUM_POINTS - outliers { (k + 1) % NUM_POINTS as u32 } else { k }])
        .collect();
    let mut pairs = Vec::new();
    for i in 0..num_images {
        for j in i + 1..num_images {
            pairs.push(Pair {
                config: PairConfig::Calibrated,
                inliers: matches.clone(),
                matches: Some(matches.clone()),
                num_matches: matches.len(),
                ..Pair::unverified(i, j)
            });
        }
    }
    (ViewGraph { cameras: vec![camera], images, pairs }, poses)
}

fn rotation_error_deg(pair: &Pair, poses: &[Rigid3]) -> f64 {
    let truth = poses[pair.image2] * poses[pair.image1].inverse();
    (pair.cam2_from_cam1.unwrap().rotation * truth.rotation.conjugate()).to_scaled_axis().length().to_degrees()
}

#[test]
fn poses_are_estimated_where_nothing_is_stored() {
    let (mut graph, poses) = graph(4, 12);
    graph.pairs[1].inliers[5] = [7, 4_000_000];
    let mut again = graph.clone();
    let summary = block_on(run(&mut graph, &Options::default(), Matches::Verified, 0, None, &mut Silent)).unwrap();
    assert_eq!((summary.estimated, graph.pairs.len()), (6, 6));
    for pair in &graph.pairs {
        assert!(rotation_error_deg(pair, &poses) < 0.2, "{}", rotation_error_deg(pair, &poses));
    }
    block_on(run(&mut again, &Options::default(), Matches::Verified, 0, None, &mut Silent)).unwrap();
    let all = |g: &ViewGraph| g.pairs.iter().map(|p| p.cam2_from_cam1).collect::<Vec<_>>();
    assert_eq!(all(&graph), all(&again));
}

#[test]
fn stored_poses_stay_until_the_focal_length_changes() {
    let (mut graph, poses) = graph(3, 0);
    let wrong = Rigid3::new(DQuat::from_rotation_z(0.5), DVec3::X);
    for pair in &mut graph.pairs {
        pair.cam2_from_cam1 = Some(wrong);
    }
    let mut solver = graph.cameras[0].clone();
    solver.params[0] = 950.0;
    graph.pairs[2].solver_cameras = [Some(solver.clone()), Some(solver)];
    let mut guessed = graph.clone();
    guessed.cameras[0].has_prior_focal = false;
    let summary = block_on(run(&mut graph, &Options::default(), Matches::Verified, 0, None, &mut Silent)).unwrap();
    assert_eq!((summary.stored, summary.estimated), (2, 1));
    assert_eq!(graph.pairs[0].cam2_from_cam1, Some(wrong));
    assert!(rotation_error_deg(&graph.pairs[2], &poses) < 0.2);
    let summary = block_on(run(&mut guessed, &Options::default(), Matches::Verified, 0, None, &mut Silent)).unwrap();
    assert_eq!(summary.stored, 3);
}

#[test]
fn weak_and_hopeless_pairs_are_dropped() {
    let (mut graph, _) = graph(4, 0);
    graph.pairs[0].config = PairConfig::Watermark;
    graph.pairs[1].inliers.truncate(14);
    let scramble = |k: u32| [k, (k * 37 + 11) % NUM_POINTS as u32];
    graph.pairs[2].inliers = (0..NUM_POINTS as u32).map(scramble).collect();
    let summary = block_on(run(&mut graph, &Options::default(), Matches::Verified, 0, None, &mut Silent)).unwrap();
    assert_eq!((summary.weak, summary.without_pose, graph.pairs.len()), (2, 1, 3), "{summary}");
}

#[test]
fn raw_matches_are_verified_again() {
    let (mut graph, poses) = graph(3, 30);
    for pair in &mut graph.pairs {
        pair.config = PairConfig::Undefined;
        pair.inliers.clear();
    }
    let summary = block_on(run(&mut graph, &Options::default(), Matches::Raw, 3, None, &mut Silent)).unwrap();
    assert_eq!(summary.estimated, 3);
    for pair in &graph.pairs {
        assert!(rotation_error_deg(pair, &poses) < 0.2);
        let right = pair.inliers.iter().filter(|m| m[0] == m[1]).count();
        assert!(right >= 85 && pair.inliers.len() - right <= 5, "{right} of {}", pair.inliers.len());
    }
}
