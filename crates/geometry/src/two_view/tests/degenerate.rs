//! Inputs that carry no geometry end in DEGENERATE or `None`, never in a panic.

use glam::DVec2;
use proptest::prelude::*;

use super::super::*;
use super::{Shape, distorted, fisheye, pinhole, scene};
use crate::camera::{Camera, CameraModel};

fn verify(camera: &Camera, points1: &[DVec2], points2: &[DVec2], matches: &[[u32; 2]]) -> TwoViewGeometry {
    estimate_two_view(camera, points1, camera, points2, matches, &TwoViewOptions::default(), 0)
}

#[test]
fn too_few_matches_are_degenerate() {
    let camera = pinhole();
    for count in [0, 1, 4, 5, 7, 14] {
        let s = scene(0, [&camera, &camera], Shape::Cloud, 1.0, count, 0.0, 0.0);
        let g = verify(&camera, &s.points1, &s.points2, &s.matches);
        assert_eq!(g.config, TwoViewConfig::Degenerate);
        assert!(g.cam2_from_cam1.is_none() && g.inliers.is_empty());
    }
}

#[test]
fn noise_is_degenerate() {
    let camera = pinhole();
    let s = scene(3, [&camera, &camera], Shape::Cloud, 1.0, 100, 0.0, 1.0);
    let g = verify(&camera, &s.points1, &s.points2, &s.matches);
    // Chance lets a handful of random pairs agree; never most of them.
    assert!(g.config == TwoViewConfig::Degenerate || g.inliers.len() < 30, "{:?} {}", g.config, g.inliers.len());
}

#[test]
fn one_point_repeated_has_no_pose() {
    for camera in [pinhole(), fisheye()] {
        let (p, q) = (vec![DVec2::new(700.0, 500.0); 60], vec![DVec2::new(720.0, 480.0); 60]);
        let matches: Vec<[u32; 2]> = (0..60).map(|i| [i, i]).collect();
        let g = verify(&camera, &p, &q, &matches);
        assert_eq!(g.config, TwoViewConfig::Degenerate);
        assert!(estimate_relative_pose(&camera, &p, &camera, &q, &RelativePoseOptions::default(), 0).is_none());
    }
}

#[test]
fn points_on_a_line_do_not_panic() {
    let camera = pinhole();
    let p: Vec<DVec2> = (0..50).map(|i| DVec2::new(20.0 * f64::from(i), 600.0)).collect();
    let q: Vec<DVec2> = p.iter().map(|p| *p + DVec2::new(30.0, 0.0)).collect();
    let matches: Vec<[u32; 2]> = (0..50).map(|i| [i, i]).collect();
    for has_prior_focal in [true, false] {
        let camera = Camera { has_prior_focal, ..camera.clone() };
        let g = verify(&camera, &p, &q, &matches);
        assert!(g.cam2_from_cam1.is_none_or(|pose| pose.is_finite()));
    }
}

#[test]
fn bad_matches_and_pixels_are_left_out() {
    let camera = distorted();
    let mut s = scene(0, [&camera, &camera], Shape::Cloud, 1.0, 100, 0.2, 0.0);
    s.points1[3] = DVec2::NAN;
    s.points2[8] = DVec2::new(f64::INFINITY, 0.0);
    s.points1[9] = DVec2::splat(1e200);
    s.matches.insert(0, [u32::MAX, 5]);
    s.matches.push([5, 100]);
    let g = verify(&camera, &s.points1, &s.points2, &s.matches);
    assert_eq!(g.config, TwoViewConfig::Calibrated);
    // Positions in the list of matches, the bad first one counted.
    assert!([0, 4, 9, 10, 101].iter().all(|i| !g.inliers.contains(i)));
    assert!(g.inliers.len() > 90);
}

#[test]
fn invalid_cameras_and_unknown_fisheyes_are_degenerate() {
    let good = pinhole();
    let s = scene(0, [&good, &good], Shape::Cloud, 1.0, 100, 0.2, 0.0);
    let zero_focal = Camera { params: vec![0.0, 0.0, 800.0, 600.0], ..pinhole() };
    let short = Camera { params: vec![1000.0], ..pinhole() };
    let nan = Camera { params: vec![f64::NAN, 1000.0, 800.0, 600.0], ..pinhole() };
    let guessed = Camera { has_prior_focal: false, ..fisheye() };
    for camera in [zero_focal, short, nan, guessed] {
        let g = verify(&camera, &s.points1, &s.points2, &s.matches);
        assert_eq!(g.config, TwoViewConfig::Degenerate);
    }
}

#[test]
fn spherical_images_are_verified_by_their_rays() {
    let camera = Camera {
        model: CameraModel::Equirectangular,
        width_px: 2000,
        height_px: 1000,
        params: vec![2000.0, 1000.0],
        has_prior_focal: false,
        ..pinhole()
    };
    let s = scene(1, [&camera, &camera], Shape::Cloud, 1.0, 200, 0.3, 0.3);
    let g = verify(&camera, &s.points1, &s.points2, &s.matches);
    assert_eq!(g.config, TwoViewConfig::Calibrated);
    assert!(g.fundamental.is_none());
    let pose = g.cam2_from_cam1.expect("a pose");
    assert!(super::rotation_error_rad(&pose, &s.cam2_from_cam1).to_degrees() < 0.2);
}

#[test]
fn ransac_options_out_of_range_do_not_hang_or_panic() {
    let camera = pinhole();
    let s = scene(0, [&camera, &camera], Shape::Cloud, 1.0, 50, 0.2, 0.0);
    for ransac in [
        RansacOptions { confidence: 1.0, max_trials: 50, ..Default::default() },
        RansacOptions { confidence: f64::NAN, ..Default::default() },
        RansacOptions { max_error_px: 0.0, ..Default::default() },
        RansacOptions { max_error_px: f64::NAN, ..Default::default() },
        RansacOptions { min_trials: 0, max_trials: 0, ..Default::default() },
        RansacOptions { min_inlier_ratio: 7.0, ..Default::default() },
    ] {
        let options = RelativePoseOptions { ransac, ..Default::default() };
        let pose = estimate_relative_pose(&camera, &s.points1, &camera, &s.points2, &options, 0);
        assert!(pose.is_none_or(|p| p.cam2_from_cam1.is_finite()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn arbitrary_matches_never_panic(
        values in proptest::collection::vec(prop_oneof![
            6 => 0.0f64..1600.0, 1 => Just(800.0), 1 => Just(f64::NAN), 1 => Just(-1e9), 1 => Just(1e300)
        ], 80),
        has_prior_focal: bool,
        repeat in 1usize..4,
    ) {
        let points: Vec<DVec2> = values.chunks(2).map(|c| DVec2::new(c[0], c[1])).collect();
        let (p, q) = points.split_at(20);
        let matches: Vec<[u32; 2]> = (0..20 * repeat as u32).map(|i| [i % 20, (i * 7) % 20]).collect();
        for camera in [pinhole(), distorted(), fisheye()] {
            let camera = Camera { has_prior_focal, ..camera };
            let g = verify(&camera, p, q, &matches);
            prop_assert!(g.cam2_from_cam1.is_none_or(|pose| pose.is_finite()));
            prop_assert!(g.inliers.iter().all(|&i| (i as usize) < matches.len()));
        }
    }
}
