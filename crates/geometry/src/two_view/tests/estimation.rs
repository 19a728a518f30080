//! Whole pairs with noise and outliers: the label, the pose and the inliers are right.

use glam::DQuat;

use super::super::*;
use super::{Shape, direction_error_rad, distorted, fisheye, pinhole, rotation_error_rad, scene};
use crate::camera::Camera;

fn verify(s: &super::Scene, cameras: [&Camera; 2], seed: u64) -> TwoViewGeometry {
    let [a, b] = cameras;
    estimate_two_view(a, &s.points1, b, &s.points2, &s.matches, &TwoViewOptions::default(), seed)
}

#[test]
fn noisy_pairs_with_outliers_give_the_pose() {
    for cameras in
        [[pinhole(), pinhole()], [distorted(), distorted()], [distorted(), pinhole()], [fisheye(), fisheye()]]
    {
        let cameras = [&cameras[0], &cameras[1]];
        for seed in 0..8 {
            let s = scene(seed, cameras, Shape::Cloud, 1.0, 400, 0.5, 0.4);
            let g = verify(&s, cameras, seed);
            assert_eq!(g.config, TwoViewConfig::Calibrated);
            let pose = g.cam2_from_cam1.expect("a pose");
            let rotation = rotation_error_rad(&pose, &s.cam2_from_cam1).to_degrees();
            let direction = direction_error_rad(&pose, &s.cam2_from_cam1).to_degrees();
            assert!(rotation < 0.15 && direction < 1.0, "{rotation}° {direction}°");
            let true_count = 400 - s.outliers;
            let found = g.inliers.iter().filter(|&&i| (i as usize) < true_count).count();
            assert!(found as f64 > 0.99 * true_count as f64);
            assert!(g.inliers.len() - found < s.outliers / 20);
            assert!(g.inliers.is_sorted());
            assert!((0.03..0.3).contains(&g.tri_angle_rad), "{}", g.tri_angle_rad);
        }
    }
}

#[test]
fn few_inliers_are_found() {
    let camera = pinhole();
    for seed in 0..5 {
        let s = scene(seed, [&camera, &camera], Shape::Cloud, 1.0, 300, 0.5, 0.7);
        let g = verify(&s, [&camera, &camera], seed);
        let pose = g.cam2_from_cam1.expect("a pose");
        assert!(rotation_error_rad(&pose, &s.cam2_from_cam1).to_degrees() < 0.5);
    }
}

#[test]
fn planar_pairs_are_labelled_and_posed() {
    for camera in [pinhole(), distorted()] {
        for seed in 0..8 {
            let s = scene(seed, [&camera, &camera], Shape::Plane, 1.5, 300, 0.3, 0.3);
            let g = verify(&s, [&camera, &camera], seed);
            assert_eq!(g.config, TwoViewConfig::Planar, "seed {seed}");
            // A plane leaves two motions; the true one or its twin must fit the matrix in the record.
            let k = calibration_matrix(&camera);
            let h = k.inverse() * g.homography.expect("a homography") * k;
            let best = decompose_homography(&h)
                .iter()
                .map(|m| rotation_error_rad(&m.cam2_from_cam1, &s.cam2_from_cam1).to_degrees())
                .fold(f64::INFINITY, f64::min);
            assert!(best < 1.0, "seed {seed}: {best}°");
            assert!(g.inliers.len() >= 205, "{}", g.inliers.len());
        }
    }
}

#[test]
fn a_plane_with_some_relief_gives_the_true_motion() {
    let camera = pinhole();
    for seed in 0..5 {
        let mut s = scene(seed, [&camera, &camera], Shape::Plane, 1.5, 260, 0.3, 0.0);
        // 15 % off the plane settle which of the two motions holds.
        let relief = scene(seed, [&camera, &camera], Shape::Cloud, 1.5, 40, 0.3, 0.0);
        assert_eq!(relief.cam2_from_cam1, s.cam2_from_cam1);
        s.points1.extend(relief.points1);
        s.points2.extend(relief.points2);
        s.matches = (0..300).map(|i| [i, i]).collect();
        let g = verify(&s, [&camera, &camera], seed);
        let pose = g.cam2_from_cam1.expect("a pose");
        assert!(rotation_error_rad(&pose, &s.cam2_from_cam1).to_degrees() < 0.2);
        assert!(direction_error_rad(&pose, &s.cam2_from_cam1).to_degrees() < 1.0);
    }
}

#[test]
fn pure_rotations_are_panoramic() {
    for camera in [pinhole(), distorted(), fisheye()] {
        for seed in 0..5 {
            let s = scene(seed, [&camera, &camera], Shape::Cloud, 0.0, 300, 0.5, 0.3);
            let g = verify(&s, [&camera, &camera], seed);
            assert_eq!(g.config, TwoViewConfig::Panoramic, "seed {seed}");
            let pose = g.cam2_from_cam1.expect("a pose");
            assert_eq!(pose.translation, glam::DVec3::ZERO);
            assert!(rotation_error_rad(&pose, &s.cam2_from_cam1).to_degrees() < 0.02);
            assert!(g.tri_angle_rad < 0.002);
        }
    }
}

#[test]
fn identical_images_are_panoramic_with_no_motion() {
    let camera = pinhole();
    let mut s = scene(0, [&camera, &camera], Shape::Cloud, 1.0, 100, 0.0, 0.0);
    s.points2 = s.points1.clone();
    let g = verify(&s, [&camera, &camera], 0);
    assert_eq!(g.config, TwoViewConfig::Panoramic);
    assert!(g.cam2_from_cam1.expect("a pose").rotation.angle_between(DQuat::IDENTITY) < 1e-6);
    assert_eq!(g.inliers.len(), 100);
}

#[test]
fn without_prior_focals_the_fundamental_matrix_decides() {
    let camera = Camera { has_prior_focal: false, ..pinhole() };
    for seed in 0..5 {
        let s = scene(seed, [&camera, &camera], Shape::Cloud, 1.0, 400, 0.3, 0.3);
        let g = verify(&s, [&camera, &camera], seed);
        assert_eq!(g.config, TwoViewConfig::Uncalibrated);
        assert!(g.essential.is_none());
        let f = g.fundamental.expect("a fundamental matrix");
        let wrong = g.inliers.iter().filter(|&&i| {
            let i = i as usize;
            sampson_error_px(&f, s.points1[i], s.points2[i]) > 4.0
        });
        assert_eq!(wrong.count(), 0);
        // The focal length is in fact right: F and K give the pose, refined like any other.
        let pose = g.cam2_from_cam1.expect("a pose");
        assert!(rotation_error_rad(&pose, &s.cam2_from_cam1).to_degrees() < 0.2);
        let assumed = TwoViewOptions { assume_calibrated: true, ..Default::default() };
        let g = estimate_two_view(&camera, &s.points1, &camera, &s.points2, &s.matches, &assumed, seed);
        assert_eq!(g.config, TwoViewConfig::Calibrated);
    }
}

#[test]
fn a_shift_of_the_border_is_a_watermark() {
    let camera = pinhole();
    let mut s = scene(1, [&camera, &camera], Shape::Cloud, 1.0, 60, 0.0, 0.0);
    for (i, (p, q)) in s.points1.iter_mut().zip(&mut s.points2).enumerate() {
        *p = glam::DVec2::new(100.0 + 20.0 * i as f64, 1150.0 + (i % 7) as f64 * 6.0);
        *q = *p + glam::DVec2::new(3.0, -2.0);
    }
    let g = verify(&s, [&camera, &camera], 0);
    assert_eq!(g.config, TwoViewConfig::Watermark);
    let off = TwoViewOptions { watermark: None, ..Default::default() };
    let g = estimate_two_view(&camera, &s.points1, &camera, &s.points2, &s.matches, &off, 0);
    assert_ne!(g.config, TwoViewConfig::Watermark);
}

#[test]
fn stored_matrices_give_the_pose_back() {
    let options = RelativePoseOptions::default();
    for camera in [pinhole(), distorted()] {
        for (shape, baseline) in [(Shape::Cloud, 1.0), (Shape::Plane, 1.0), (Shape::Cloud, 0.0)] {
            let s = scene(4, [&camera, &camera], shape, baseline, 300, 0.3, 0.2);
            let g = verify(&s, [&camera, &camera], 4);
            let expected = g.cam2_from_cam1.expect("a pose");
            let pick = |p: &[glam::DVec2]| g.inliers.iter().map(|&i| p[i as usize]).collect::<Vec<_>>();
            let (p1, p2) = (pick(&s.points1), pick(&s.points2));
            let decompose = |e, f, h| {
                relative_pose_from_geometry(g.config, e, f, h, &camera, &p1, &camera, &p2, &options, 7).expect("a pose")
            };
            let stored = decompose(g.essential.as_ref(), g.fundamental.as_ref(), g.homography.as_ref());
            let estimated = decompose(None, None, None);
            assert_eq!(stored.source, PoseSource::Stored);
            assert_eq!(estimated.source, PoseSource::Estimated);
            // A plane without relief leaves two motions open; else the refinement ends in the same minimum.
            if shape == Shape::Cloud {
                assert!(rotation_error_rad(&stored.cam2_from_cam1, &expected).to_degrees() < 0.01);
                assert!(rotation_error_rad(&estimated.cam2_from_cam1, &expected).to_degrees() < 0.1);
            }
            let broken = decompose(Some(&glam::DMat3::IDENTITY), None, Some(&glam::DMat3::ZERO));
            if shape == Shape::Cloud {
                assert!(rotation_error_rad(&broken.cam2_from_cam1, &expected).to_degrees() < 0.1);
            }
        }
    }
    for config in [TwoViewConfig::Undefined, TwoViewConfig::Degenerate, TwoViewConfig::Watermark] {
        let s = scene(4, [&pinhole(), &pinhole()], Shape::Cloud, 1.0, 50, 0.3, 0.0);
        let pose = relative_pose_from_geometry(
            config,
            None,
            None,
            None,
            &pinhole(),
            &s.points1,
            &pinhole(),
            &s.points2,
            &options,
            0,
        );
        assert!(pose.is_none());
    }
}

#[test]
fn the_same_seed_gives_the_same_result() {
    let camera = distorted();
    let s = scene(2, [&camera, &camera], Shape::Cloud, 1.0, 300, 0.5, 0.5);
    let (a, b) = (verify(&s, [&camera, &camera], 5), verify(&s, [&camera, &camera], 5));
    assert_eq!((a.inliers, a.cam2_from_cam1, a.fundamental), (b.inliers, b.cam2_from_cam1, b.fundamental));
    let other = verify(&s, [&camera, &camera], 6).cam2_from_cam1.expect("a pose");
    let difference = rotation_error_rad(&other, &a.cam2_from_cam1.expect("a pose")).to_degrees();
    // Half a pixel of noise leaves more than this open.
    assert!(difference < 0.05, "{difference}");
}
