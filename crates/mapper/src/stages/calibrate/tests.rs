//! Known focal lengths, guessed wrong, recovered from noisy fundamental matrices.

use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::CameraModel;
use epipole_geometry::two_view::essential_from_pose;
use epipole_scene::ViewImage;
use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};

use super::*;
use crate::event::Silent;

fn camera(id: u32, focal_px: f64, has_prior_focal: bool) -> Camera {
    Camera {
        id,
        model: CameraModel::SimpleRadial,
        width_px: 1600,
        height_px: 1200,
        params: vec![focal_px, 800.0, 600.0, 0.0],
        has_prior_focal,
    }
}

/// Images that look at the origin from all sides, with the fundamental matrices of all pairs; a share of them is wrong.
fn graph(image_camera: &[usize], truth_px: &[f64], cameras: Vec<Camera>, wrong: f64) -> ViewGraph {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let mut uniform = |scale: f64| (2.0 * rng.random::<f64>() - 1.0) * scale;
    let poses: Vec<Rigid3> = image_camera
        .iter()
        .map(|_| {
            // Axes that meet in one point leave the focal length open, so each looks a little past it.
            let turn = DQuat::from_rotation_y(uniform(1.5)) * DQuat::from_rotation_x(uniform(0.6));
            let past = DQuat::from_scaled_axis(DVec3::new(uniform(0.3), uniform(0.3), uniform(0.5)));
            Rigid3::new(past * turn, DVec3::new(uniform(1.0), uniform(1.0), 5.0 + uniform(2.0)))
        })
        .collect();
    let image = |(i, &camera): (usize, &usize)| ViewImage {
        id: i as u32 + 1,
        name: format!("{i}"),
        camera,
        keypoints_px: Arc::from([]),
        depths: None,
    };
    let mut pairs = Vec::new();
    for i in 0..poses.len() {
        for j in i + 1..poses.len() {
            let mut pose = poses[j] * poses[i].inverse();
            pose.translation = pose.translation.normalize();
            let k = |image: usize| calibration_matrix(&camera(0, truth_px[image_camera[image]], true)).inverse();
            let mut f = k(j).transpose() * essential_from_pose(&pose) * k(i);
            if uniform(1.0).abs() < wrong {
                f.x_axis *= 1.0 + uniform(1.0);
                f.z_axis.y *= 1.0 + uniform(1.0);
            }
            f.z_axis.x *= 1.0 + uniform(1e-3);
            pairs.push(Pair {
                config: PairConfig::Uncalibrated,
                fundamental: Some(f),
                cam2_from_cam1: Some(pose),
                ..Pair::unverified(i, j)
            });
        }
    }
    ViewGraph { cameras, images: image_camera.iter().enumerate().map(image).collect(), pairs }
}

#[test]
fn one_camera_is_recovered_among_wrong_pairs() {
    let mut graph = graph(&[0; 12], &[1310.0], vec![camera(1, 1920.0, false)], 0.2);
    let mut again = graph.clone();
    let summary = run(&mut graph, &Options::default(), &mut Silent).unwrap();
    let focal = graph.cameras[0].mean_focal_px();
    assert!((focal / 1310.0 - 1.0).abs() < 0.01, "{focal}");
    assert!(graph.cameras[0].has_prior_focal && summary.calibrated.len() == 1 && summary.still_guessed == 0);
    // The poses were found with the guess.
    assert_eq!(summary.cleared_poses, graph.pairs.len());
    run(&mut again, &Options::default(), &mut Silent).unwrap();
    assert_eq!(again.cameras, graph.cameras);
}

#[test]
fn known_cameras_stay_and_unknown_ones_get_their_own() {
    let cameras = vec![camera(1, 1000.0, true), camera(2, 1920.0, false), camera(3, 1920.0, false)];
    let mut graph = graph(&[0, 1, 2, 0, 1, 2, 0, 1, 2], &[1000.0, 1500.0, 2400.0], cameras, 0.1);
    run(&mut graph, &Options::default(), &mut Silent).unwrap();
    for (camera, truth) in graph.cameras.iter().zip([1000.0, 1500.0, 2400.0]) {
        assert!((camera.mean_focal_px() / truth - 1.0).abs() < 0.02, "{}", camera.mean_focal_px());
    }
    assert_eq!(graph.cameras[0].params[0], 1000.0);
}

#[test]
fn a_graph_that_says_nothing_leaves_the_guess() {
    let mut graph = graph(&[0; 4], &[1310.0], vec![camera(1, 1920.0, false)], 1.0);
    let summary = run(&mut graph, &Options::default(), &mut Silent).unwrap();
    assert_eq!((graph.cameras[0].params[0], graph.cameras[0].has_prior_focal), (1920.0, false));
    assert_eq!((summary.calibrated.len(), summary.still_guessed, summary.cleared_poses), (0, 1, 0));
}

#[test]
fn an_essential_matrix_counts_with_the_intrinsics_it_was_found_with() {
    let mut graph = graph(&[0; 10], &[1310.0], vec![camera(1, 1920.0, false)], 0.0);
    for pair in &mut graph.pairs {
        let k = calibration_matrix(&camera(0, 1300.0, true));
        pair.essential = pair.fundamental.take().map(|f| k.transpose() * f * k);
        pair.solver_cameras = [Some(camera(0, 1300.0, true)), Some(camera(0, 1300.0, true))];
    }
    run(&mut graph, &Options::default(), &mut Silent).unwrap();
    assert!((graph.cameras[0].mean_focal_px() / 1310.0 - 1.0).abs() < 0.01, "{}", graph.cameras[0].mean_focal_px());
}
