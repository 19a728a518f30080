//! Synthetic scenes are reconstructed to their truth, through noise, wrong matches and wrong pairs.

mod common;

use common::{check_round_trip, compare, run};
use epipole_geometry::camera::CameraModel;
use epipole_mapper::{Intrinsics, Matches, Options, Outcome};
use epipole_scene::statistics::Statistics;
use epipole_tests::synth::{self, FocalKnowledge, Kind, Scene, StoredPoses, generate};

fn make(options: synth::Options) -> Scene {
    generate(&options).expect("a scene")
}

/// All images in one component, poses within the given share of the scene's extent and the given angle.
fn assert_recovered(name: &str, scene: &Scene, outcome: &Outcome, max_ate_share: f64, max_rotation_deg: f64) {
    assert_eq!(outcome.reconstructions.len(), 1, "{name}: components");
    let model = &outcome.reconstructions[0];
    let found = compare(model, &scene.truth);
    let ate = found.ate.expect("three or more images");
    let rotation = found.absolute_rotation.expect("three or more images");
    println!(
        "{name}: {} of {} images, {} points, {:.3} px, ATE {:.2e} of the extent, rotation {:.3}° at most",
        found.common_images,
        scene.truth.images.len(),
        model.points.len(),
        Statistics::of(model).mean_reprojection_error_px,
        ate.rmse_over_extent,
        rotation.max_deg
    );
    assert_eq!(found.common_images, scene.truth.images.len(), "{name}: images");
    assert!(ate.rmse_over_extent < max_ate_share, "{name}: ATE {} of the extent", ate.rmse_over_extent);
    assert!(rotation.max_deg < max_rotation_deg, "{name}: rotation {}°", rotation.max_deg);
}

#[test]
fn every_kind_is_recovered() {
    for (kind, seed) in [(Kind::Orbit, 11), (Kind::Street, 12), (Kind::Facade, 13), (Kind::Internet, 14)] {
        let scene = make(synth::Options { kind, seed, num_images: 24, num_points: 2000, ..Default::default() });
        let outcome = run(&scene.graph, &Options::default());
        assert_recovered(&format!("{kind:?}"), &scene, &outcome, 2e-3, 0.3);
        let error = Statistics::of(&outcome.reconstructions[0]).mean_reprojection_error_px;
        // The noise alone gives 0.627 px less what the points' freedom takes up.
        assert!((0.4..0.7).contains(&error), "{kind:?}: {error} px");
        check_round_trip(&outcome.reconstructions[0]);
    }
}

#[test]
fn exact_observations_give_exact_poses() {
    let scene = make(synth::Options { noise_px: 0.0, outlier_share: 0.0, num_images: 12, ..Default::default() });
    let outcome = run(&scene.graph, &Options { intrinsics: Intrinsics::Fixed, ..Options::default() });
    assert_recovered("no noise", &scene, &outcome, 1e-5, 1e-3);
}

#[test]
fn wrong_matches_and_wrong_pairs_are_survived() {
    let scene = make(synth::Options {
        seed: 21,
        num_images: 30,
        num_points: 2500,
        outlier_share: 0.15,
        wrong_pair_share: 0.15,
        ..Default::default()
    });
    assert_recovered("wrong pairs", &scene, &run(&scene.graph, &Options::default()), 3e-3, 0.3);
}

#[test]
fn raw_matches_are_enough() {
    let mut scene = make(synth::Options { seed: 22, num_images: 12, raw_outlier_share: 0.4, ..Default::default() });
    for pair in &mut scene.graph.pairs {
        pair.inliers.clear();
        (pair.cam2_from_cam1, pair.essential, pair.fundamental) = (None, None, None);
    }
    let outcome = run(&scene.graph, &Options { matches: Matches::Raw, ..Options::default() });
    assert_recovered("raw matches", &scene, &outcome, 4e-3, 0.4);
}

#[test]
fn poses_are_estimated_where_the_database_has_none() {
    let scene = make(synth::Options {
        seed: 23,
        num_images: 14,
        num_points: 1200,
        poses: StoredPoses::Absent,
        ..Default::default()
    });
    assert_recovered("no stored poses", &scene, &run(&scene.graph, &Options::default()), 3e-3, 0.3);
}

#[test]
fn guessed_focal_lengths_are_found() {
    let scene = make(synth::Options {
        kind: Kind::Street,
        seed: 24,
        num_images: 24,
        num_points: 2500,
        focal: FocalKnowledge::Guessed,
        poses: StoredPoses::Absent,
        ..Default::default()
    });
    let outcome = run(&scene.graph, &Options::default());
    assert_recovered("guessed focal", &scene, &outcome, 1e-2, 0.7);
    let (found, truth) =
        (outcome.reconstructions[0].cameras[0].mean_focal_px(), scene.truth.cameras[0].mean_focal_px());
    assert!((found / truth - 1.0).abs() < 0.02, "focal length {found} px, truth {truth} px");
}

#[test]
fn many_cameras_of_many_models() {
    let scene = make(synth::Options {
        seed: 25,
        num_images: 24,
        num_points: 2500,
        num_cameras: 6,
        models: vec![
            CameraModel::Pinhole,
            CameraModel::OpenCv,
            CameraModel::OpenCvFisheye,
            CameraModel::Radial,
            CameraModel::FullOpenCv,
            CameraModel::Eucm,
        ],
        ..Default::default()
    });
    let outcome = run(&scene.graph, &Options { intrinsics: Intrinsics::Fixed, ..Options::default() });
    assert_recovered("six models", &scene, &outcome, 2e-3, 0.3);
}

#[test]
fn a_loop_closes() {
    let scene = make(synth::Options {
        kind: Kind::Street,
        loop_closure: true,
        seed: 26,
        num_images: 60,
        num_points: 6000,
        max_pairs_per_image: Some(12),
        ..Default::default()
    });
    assert_recovered("loop", &scene, &run(&scene.graph, &Options::default()), 3e-3, 0.5);
}

#[test]
fn two_components_come_out_largest_first() {
    let mut scene = make(synth::Options { seed: 27, num_images: 12, num_points: 1000, ..Default::default() });
    let small = scene.truth.clone();
    let other = make(synth::Options { kind: Kind::Street, seed: 28, num_images: 16, ..Default::default() });
    let large = scene.append(other);
    let outcome = run(&scene.graph, &Options::default());
    assert_eq!(outcome.reconstructions.len(), 2);
    for (model, truth) in outcome.reconstructions.iter().zip([&large, &small]) {
        let found = compare(model, truth);
        assert_eq!((found.common_images, found.estimate_images), (truth.images.len(), truth.images.len()));
        assert!(found.ate.expect("enough images").rmse_over_extent < 4e-3);
    }
    let components: Vec<_> = outcome.report.images.iter().map(|i| i.component).collect();
    assert!(components[..12].iter().all(|&c| c == Some(1)) && components[12..].iter().all(|&c| c == Some(0)));
}

#[test]
fn every_missing_image_has_a_reason() {
    let mut scene = make(synth::Options { seed: 29, num_images: 12, num_points: 800, ..Default::default() });
    // One image without keypoints, one without pairs, one that keeps a handful of matches.
    scene.graph.images[2].keypoints_px = std::sync::Arc::from([]);
    scene.graph.pairs.retain(|p| ![2, 5].iter().any(|i| [p.image1, p.image2].contains(i)));
    for pair in scene.graph.pairs.iter_mut().filter(|p| p.image1 == 8 || p.image2 == 8) {
        pair.inliers.truncate(4);
        pair.matches = None;
    }
    let outcome = run(&scene.graph, &Options::default());
    assert_eq!(outcome.report.num_registered, 9);
    for (i, image) in outcome.report.images.iter().enumerate() {
        assert_eq!(image.component.is_none(), [2, 5, 8].contains(&i), "image {i}");
        assert_eq!(image.component.is_none(), image.unregistered.is_some(), "image {i}");
    }
}
