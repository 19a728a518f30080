//! The comparison on made-up poses whose errors are known, and against the comparison script on a real model.

use std::fs;

use epipole_geometry::Rigid3;
use glam::{DQuat, DVec3};

use super::*;
use crate::Image;
use crate::fixture::row_of_cameras;

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} instead of {b}");
}

#[test]
fn a_model_agrees_with_itself_in_another_frame() {
    let reference = row_of_cameras(6, 0);
    let mut estimate = reference.clone();
    estimate.images.reverse();
    estimate.transform(&epipole_geometry::Similarity3 {
        scale: 3.0,
        rotation: DQuat::from_rotation_y(1.0),
        translation: DVec3::new(5.0, 4.0, 3.0),
    });
    let found = evaluate(&estimate, &reference, &EvaluateOptions::default());
    assert_eq!((found.estimate_images, found.reference_images, found.common_images), (6, 6, 6));
    close(found.auc_all.at_1, 100.0, 1e-5);
    let (ate, rigid) = (found.ate.expect("six images"), found.ate_rigid.expect("six images"));
    close(ate.rmse, 0.0, 1e-12);
    close(ate.scale, 1.0 / 3.0, 1e-12);
    close(found.scale_error.expect("six images"), 2.0, 1e-12);
    assert!(rigid.rmse > 1.0, "the rigid error sees the scale");
    close(found.absolute_rotation.expect("six images").max_deg, 0.0, 1e-5);
    close(found.reference_extent, 5.0, 1e-12);
}

#[test]
fn the_area_is_exact_and_missing_pairs_count() {
    close(area_under_recall(&[0.0, 1.0, 3.0, 180.0], 4, 2.0), (2.0 + 1.0) / 8.0, 1e-15);
    close(area_under_recall(&[0.0], 4, 5.0), 0.25, 1e-15);
    assert_eq!(area_under_recall(&[], 0, 5.0), 0.0);
    let reference = row_of_cameras(4, 0);
    let mut estimate = reference.clone();
    estimate.images.pop();
    let found = evaluate(&estimate, &reference, &EvaluateOptions::default());
    close(found.auc_all.at_5, 50.0, 1e-4);
    close(found.auc_registered.expect("three images").at_5, 100.0, 1e-4);
    estimate.images.truncate(1);
    let found = evaluate(&estimate, &reference, &EvaluateOptions::default());
    assert_eq!((found.auc_all.at_10, found.auc_registered, found.ate), (0.0, None, None));
    let empty = evaluate(&Default::default(), &Default::default(), &EvaluateOptions::default());
    assert_eq!((empty.common_images, empty.auc_all.at_1), (0, 0.0));
}

#[test]
fn the_worse_of_rotation_and_direction_counts() {
    let reference = row_of_cameras(2, 0);
    let mut estimate = reference.clone();
    let turn = DQuat::from_rotation_z(2f64.to_radians());
    let pose = &mut estimate.images[1].cam_from_world;
    *pose = Rigid3::from_rotation_and_center(turn, pose.center());
    let found = evaluate(&estimate, &reference, &EvaluateOptions::default());
    close(found.relative_rotation.expect("a pair").mean_deg, 2.0, 1e-9);
    close(found.relative_direction.expect("a pair").median_deg, 2.0, 1e-9);
    close(found.auc_all.at_10, 80.0, 1e-9);
    let same_place = EvaluateOptions { min_baseline: 1.0, ..Default::default() };
    assert_eq!(evaluate(&estimate, &reference, &same_place).relative_direction.map(|d| d.mean_deg), Some(0.0));
}

#[test]
fn names_are_compared_as_asked() {
    assert_eq!(MatchBy::Name.key("a/b.c.jpg"), "a/b.c.jpg");
    assert_eq!(MatchBy::Base.key("a/b.c.jpg"), "b.c.jpg");
    assert_eq!(MatchBy::Stem.key("a/b.c.jpg"), "b.c");
    assert_eq!(MatchBy::Stem.key("a/.hidden"), ".hidden");
    assert_eq!(MatchBy::Stem.key("a.b/c"), "c");
    let reference = row_of_cameras(3, 0);
    let mut estimate = reference.clone();
    for image in &mut estimate.images {
        image.name = image.name.replace("folder/", "").replace("jpg", "png");
    }
    for (match_by, common) in [(MatchBy::Name, 0), (MatchBy::Base, 0), (MatchBy::Stem, 3)] {
        let options = EvaluateOptions { match_by, ..Default::default() };
        assert_eq!(evaluate(&estimate, &reference, &options).common_images, common);
    }
}

#[test]
fn medians_are_those_of_sorted_lists() {
    assert_eq!(median(&mut []), None);
    assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
}

/// Expected numbers: `eval_poses.py` on the same perturbation of the same model.
#[test]
fn a_real_model_gives_the_numbers_of_the_comparison_script() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/bonsai292/colmap_global/images.txt");
    let Ok(text) = fs::read_to_string(path) else {
        println!("skipped: no shared data");
        return;
    };
    let images = text.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty()).map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let v: Vec<f64> = fields[1..8].iter().map(|f| f.parse().expect("a number")).collect();
        Image {
            id: fields[0].parse().expect("an id"),
            name: fields[9].to_owned(),
            camera: 0,
            cam_from_world: Rigid3::new(DQuat::from_xyzw(v[1], v[2], v[3], v[0]), DVec3::new(v[4], v[5], v[6])),
            keypoints_px: Vec::new().into(),
            depths: None,
        }
    });
    let reference = Reconstruction { images: images.collect(), ..Default::default() };
    let mut estimate = reference.clone();
    for (k, image) in estimate.images.iter_mut().enumerate() {
        let x = k as f64;
        let turn = DQuat::from_rotation_z(0.01 * (3.0 * x).sin());
        let mut center = image.cam_from_world.center();
        center += 0.05 * DVec3::new(x.sin(), (2.0 * x).cos(), (5.0 * x).sin());
        if k % 37 == 5 {
            center += DVec3::new(3.0, -2.0, 1.0);
        }
        image.cam_from_world = Rigid3::from_rotation_and_center(turn * image.cam_from_world.rotation, center);
    }
    let mut k = 0;
    estimate.images.retain(|_| {
        k += 1;
        (k - 1) % 10 != 3
    });

    let found = evaluate(&estimate, &reference, &EvaluateOptions::default());
    assert_eq!((found.estimate_images, found.reference_images, found.common_images), (263, 292, 263));
    // The script rounds areas to two decimals and angles to four.
    let (all, registered) = (found.auc_all, found.auc_registered.expect("263 images"));
    for (ours, expected) in [
        (all.at_1, 17.01),
        (all.at_3, 49.29),
        (all.at_5, 59.08),
        (all.at_10, 67.43),
        (registered.at_1, 20.97),
        (registered.at_3, 60.78),
        (registered.at_5, 72.86),
        (registered.at_10, 83.15),
    ] {
        close(ours, expected, 0.005_001);
    }
    let (rotation, direction) = (found.relative_rotation.expect("pairs"), found.relative_direction.expect("pairs"));
    let absolute = found.absolute_rotation.expect("263 images");
    for (ours, expected) in [
        (rotation.median_deg, 0.523),
        (rotation.mean_deg, 0.5255),
        (direction.median_deg, 0.8151),
        (direction.mean_deg, 3.2533),
        (absolute.median_deg, 0.3997),
        (absolute.mean_deg, 0.3616),
        (absolute.max_deg, 0.5766),
    ] {
        close(ours, expected, 5.001e-5);
    }
    let (ate, rigid) = (found.ate.expect("263 images"), found.ate_rigid.expect("263 images"));
    for (ours, expected) in [
        (ate.rmse, 0.596_394_791_340_281_2),
        (ate.median, 0.144_257_446_992_954_34),
        (ate.max, 3.691_923_014_490_046_6),
        (ate.rmse_over_extent, 0.048_484_489_721_118_88),
        (ate.scale, 0.973_412_893_366_954_4),
        (rigid.rmse, 0.604_981_340_178_636),
        (rigid.median, 0.118_317_968_033_279_03),
        (rigid.max, 3.733_539_047_074_421_6),
        (found.reference_extent, 12.300_733_590_695_16),
    ] {
        close(ours, expected, 1e-9);
    }
    // Another generator draws other samples, but the same centres are right.
    let robust = found.ate_robust.expect("263 images");
    close(robust.rmse, 0.613_032_160_197_617_1, 1e-9);
    close(robust.median, 0.062_447_572_982_296_24, 1e-9);
}
