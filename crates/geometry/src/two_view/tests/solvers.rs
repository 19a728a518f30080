//! Every solver finds the truth in exact data to rounding.

use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

use super::super::*;
use super::{Scene, Shape, fisheye, pinhole, rotation_error_rad, scene};
use crate::camera::Camera;

/// The distance of two matrices of equal norm up to sign.
fn distance(a: DMat3, b: DMat3) -> f64 {
    let norm = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
    let (a, b) = (a * (1.0 / norm(a)), b * (1.0 / norm(b)));
    norm(a - b).min(norm(a + b))
}

fn exact(seed: u64, camera: &Camera, shape: Shape, count: usize) -> (Scene, Vec<DVec3>, Vec<DVec3>) {
    let s = scene(seed, [camera, camera], shape, 1.5, count, 0.0, 0.0);
    let rays = |points: &[DVec2]| points.iter().map(|&p| camera.ray_from_pixel(p).expect("has a ray")).collect();
    let (rays1, rays2) = (rays(&s.points1), rays(&s.points2));
    (s, rays1, rays2)
}

/// Points divided by 1000 px: centred well enough for the seven-point solver.
fn scaled(points: &[DVec2]) -> Vec<DVec2> {
    points.iter().map(|p| (*p - DVec2::new(800.0, 600.0)) / 1000.0).collect()
}

#[test]
fn five_point_finds_the_true_essential_matrix() {
    let mut errors = Vec::new();
    for seed in 0..200 {
        for camera in [pinhole(), fisheye()] {
            let (s, rays1, rays2) = exact(seed, &camera, Shape::Cloud, 5);
            let mut solutions = Vec::new();
            five_point(rays1.first_chunk().expect("enough"), rays2.first_chunk().expect("enough"), &mut solutions);
            assert!(solutions.len() <= 10);
            for e in &solutions {
                let worst = rays1.iter().zip(&rays2).map(|(p, q)| q.dot(*e * *p).abs()).fold(0.0, f64::max);
                assert!(worst < 1e-10, "{worst}");
            }
            let truth = essential_from_pose(&s.cam2_from_cam1);
            errors.push(solutions.iter().map(|e| distance(*e, truth)).fold(f64::INFINITY, f64::min));
        }
    }
    errors.sort_by(f64::total_cmp);
    // Rare samples are nearly degenerate and amplify rounding.
    assert!(errors[errors.len() / 2] < 1e-11, "median {}", errors[errors.len() / 2]);
    assert!(errors[errors.len() * 97 / 100] < 1e-6, "97 % {}", errors[errors.len() * 97 / 100]);
}

#[test]
fn seven_point_finds_the_true_fundamental_matrix() {
    let camera = pinhole();
    let k = calibration_matrix(&camera);
    let to_px = DMat3::from_cols(DVec3::X * 1000.0, DVec3::Y * 1000.0, DVec3::new(800.0, 600.0, 1.0));
    let mut errors = Vec::new();
    for seed in 0..100 {
        let (s, ..) = exact(seed, &camera, Shape::Cloud, 7);
        let mut solutions = Vec::new();
        let (p, q) = (scaled(&s.points1), scaled(&s.points2));
        seven_point(p.first_chunk().expect("enough"), q.first_chunk().expect("enough"), &mut solutions);
        assert!(!solutions.is_empty() && solutions.len() <= 3);
        let back = k.inverse() * to_px;
        let truth = back.transpose() * essential_from_pose(&s.cam2_from_cam1) * back;
        assert!(solutions.iter().all(|f| f.determinant().abs() < 1e-12));
        errors.push(solutions.iter().map(|f| distance(*f, truth)).fold(f64::INFINITY, f64::min));
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[50] < 1e-11, "median {}", errors[50]);
    assert!(errors[95] < 1e-7, "95 % {}", errors[95]);
}

#[test]
fn eight_point_solvers_find_the_truth() {
    for seed in 0..20 {
        for count in [8, 9, 60] {
            let camera = pinhole();
            let (s, rays1, rays2) = exact(seed, &camera, Shape::Cloud, count);
            let truth = essential_from_pose(&s.cam2_from_cam1);
            let e = eight_point_essential(&rays1, &rays2).expect("general position");
            assert!(distance(e, truth) < 1e-6, "{}", distance(e, truth));
            let f = eight_point_fundamental(&s.points1, &s.points2).expect("general position");
            let k = calibration_matrix(&camera);
            let e = k.transpose() * f * k;
            assert!(distance(e, truth) < 1e-6, "{}", distance(e, truth));
            assert!(s.points1.iter().zip(&s.points2).all(|(p, q)| sampson_error_px(&f, *p, *q) < 1e-6));
        }
    }
}

#[test]
fn homography_solvers_find_the_plane() {
    for seed in 0..20 {
        let camera = pinhole();
        let (s, rays1, rays2) = exact(seed, &camera, Shape::Plane, 40);
        let normal = DVec3::new(0.3, 0.1, 1.0) / 8.0;
        let t = s.cam2_from_cam1.translation;
        let truth = s.cam2_from_cam1.rotation_matrix() + DMat3::from_cols(t * normal.x, t * normal.y, t * normal.z);
        let minimal = homography_four_point(rays1.first_chunk().expect("enough"), rays2.first_chunk().expect("enough"));
        let many = homography_least_squares(&rays1, &rays2).expect("general position");
        assert!(distance(minimal.expect("general position"), truth) < 1e-9);
        assert!(distance(many, truth) < 1e-9, "{}", distance(many, truth));
        let k = calibration_matrix(&camera);
        let h = k * truth * k.inverse();
        assert!(s.points1.iter().zip(&s.points2).all(|(p, q)| homography_transfer_error_px(&h, *p, *q) < 1e-7));
        let motions = decompose_homography(&many);
        let best = motions.iter().map(|m| rotation_error_rad(&m.cam2_from_cam1, &s.cam2_from_cam1));
        assert!(best.fold(f64::INFINITY, f64::min) < 1e-6);
    }
}

#[test]
fn a_mirrored_sample_has_no_homography() {
    let rays1 =
        [DVec3::new(0.0, 0.0, 1.0), DVec3::new(1.0, 0.0, 1.0), DVec3::new(1.0, 1.0, 1.0), DVec3::new(0.0, 1.0, 1.0)];
    let mirrored = rays1.map(|r| DVec3::new(-r.x, r.y, r.z));
    assert!(homography_four_point(&rays1, &rays1).is_some());
    assert!(homography_four_point(&rays1, &mirrored).is_none());
}

#[test]
fn tangent_sampson_error_is_the_distance_to_the_epipolar_geometry() {
    // To first order, moving a match off by d across the epipolar lines of both images costs d/√2; along them nothing.
    for camera in [pinhole(), super::distorted(), fisheye()] {
        let (s, rays1, _) = exact(3, &camera, Shape::Cloud, 30);
        let e = essential_from_pose(&s.cam2_from_cam1);
        for (i, (p, q)) in s.points1.iter().zip(&s.points2).enumerate() {
            assert!(tangent_sampson_error_px(&e, &camera, *p, &camera, *q) < 1e-7);
            // Sliding the point along its first ray moves the second pixel along the epipolar curve.
            let depth = 7.0 + i as f64 / 10.0;
            let slid = camera.project(s.cam2_from_cam1.transform_point(rays1[i] * depth));
            if let Some(slid) = slid {
                assert!(tangent_sampson_error_px(&e, &camera, *p, &camera, slid) < 1e-6);
            }
            let off = *q + DVec2::new(0.3, -0.4);
            assert!(tangent_sampson_error_px(&e, &camera, *p, &camera, off) <= 0.5 * 1.01);
        }
    }
}

#[test]
fn tangent_sampson_of_a_pinhole_camera_is_the_sampson_error() {
    let camera = pinhole();
    let s = scene(9, [&camera, &camera], Shape::Cloud, 1.0, 50, 2.0, 0.0);
    let e = essential_from_pose(&s.cam2_from_cam1);
    let inverse = calibration_matrix(&camera).inverse();
    let f = inverse.transpose() * e * inverse;
    for (p, q) in s.points1.iter().zip(&s.points2) {
        let (a, b) = (tangent_sampson_error_px(&e, &camera, *p, &camera, *q), sampson_error_px(&f, *p, *q));
        // Equal to first order: normalising the rays adds the error times its own relative change.
        assert!((a - b).abs() < 1e-2 * b, "{a} {b}");
    }
}

#[test]
fn refinement_reaches_the_truth_from_nearby() {
    for (seed, camera) in [pinhole(), super::distorted(), fisheye()].iter().enumerate() {
        let s = scene(seed as u64, [camera, camera], Shape::Cloud, 1.0, 100, 0.0, 0.0);
        let nudge = crate::Rigid3::new(glam::DQuat::from_scaled_axis(DVec3::new(0.01, -0.02, 0.01)), DVec3::ZERO);
        let mut start = nudge * s.cam2_from_cam1;
        start.translation += DVec3::new(0.03, 0.02, -0.04);
        let options = RefineOptions { max_iterations: 50, loss: SampsonLoss::Cauchy(4.0) };
        let refined = refine_relative_pose(camera, &s.points1, camera, &s.points2, &start, &options).expect("enough");
        assert!(rotation_error_rad(&refined.cam2_from_cam1, &s.cam2_from_cam1) < 1e-8);
        assert!(super::direction_error_rad(&refined.cam2_from_cam1, &s.cam2_from_cam1) < 1e-8);
        assert!(refined.final_cost < 1e-8 * refined.initial_cost);
    }
}

proptest! {
    #[test]
    fn solvers_never_panic(values in proptest::collection::vec(prop_oneof![
        4 => -2.0f64..2.0, 1 => Just(0.0), 1 => Just(1.0), 1 => Just(f64::NAN), 1 => Just(1e300), 1 => Just(f64::INFINITY)
    ], 60)) {
        let ray = |i: usize| DVec3::new(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
        let point = |i: usize| DVec2::new(values[2 * i], values[2 * i + 1]);
        let mut solutions = Vec::new();
        five_point(&std::array::from_fn(ray), &std::array::from_fn(|i| ray(i + 5)), &mut solutions);
        prop_assert!(solutions.len() <= 10);
        seven_point(&std::array::from_fn(point), &std::array::from_fn(|i| point(i + 7)), &mut solutions);
        prop_assert!(solutions.iter().all(|m| m.is_finite()));
        let (rays1, rays2): (Vec<_>, Vec<_>) = (0..10).map(|i| (ray(i), ray(i + 10))).unzip();
        let (points1, points2): (Vec<_>, Vec<_>) = (0..10).map(|i| (point(i), point(i + 10))).unzip();
        let found = [
            eight_point_essential(&rays1, &rays2),
            eight_point_fundamental(&points1, &points2),
            homography_least_squares(&rays1, &rays2),
            homography_four_point(rays1.first_chunk().expect("enough"), rays2.first_chunk().expect("enough")),
        ];
        for m in found.into_iter().flatten() {
            prop_assert!(m.is_finite());
            let _ = (decompose_essential(&m), decompose_homography(&m));
        }
    }
}
