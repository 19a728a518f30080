//! Depth maps make models metric, end to end: from a plain clone's fixture, in every component, and with wide lenses.

mod common;

use std::sync::Arc;

use common::{compare, run};
use epipole_formats::depth::attach_depths;
use epipole_formats::{ReadOptions, read_database, read_model};
use epipole_geometry::camera::CameraModel;
use epipole_mapper::{Intrinsics, Options, Outcome};
use epipole_scene::depth::{DepthKind, DepthOptions, ImageDepths, KeypointDepth};
use epipole_scene::{Reconstruction, ViewGraph};
use epipole_tests::fixtures;
use epipole_tests::synth::{self, DepthModel, Kind, MapFiles, Scene, generate, give_depths, write_depth_maps};
use glam::DVec2;

fn with_depths(options: synth::Options, model: &DepthModel) -> Scene {
    let mut scene = generate(&synth::Options { depth: true, ..options }).expect("a scene");
    give_depths(&mut scene, model).expect("depths");
    scene
}

/// How much longer than in truth lengths are in a component, as a share.
fn scale_error(outcome: &Outcome, component: usize, truth: &Reconstruction) -> f64 {
    compare(&outcome.reconstructions[component], truth).scale_error.expect("enough images")
}

#[test]
fn the_fixture_comes_out_in_metres() {
    let folder = fixtures::folder().join("orbit");
    let mut graph: ViewGraph =
        read_database(&folder.join("database.db"), &ReadOptions::default()).expect("the database").value;
    let truth = read_model(&folder.join("truth")).expect("the truth").value;
    let without = run(&graph, &Options::default());
    assert!(without.report.components[0].metric.is_none(), "no depth, no metres");
    assert!(scale_error(&without, 0, &truth).abs() > 0.05, "a scale that is right by chance tests nothing");

    let options = Options::default();
    let input = attach_depths(&mut graph, &folder.join("depth"), None, &options.depth, &mut |_, _| true);
    let input = input.expect("the fixture's maps");
    assert!(input.unreadable.is_empty() && (1..5).contains(&input.missing.len()), "{input:?}");
    let outcome = run(&graph, &options);
    let metric = outcome.report.components[0].metric.as_ref().expect("metric");
    let (with, aligned) = (compare(&outcome.reconstructions[0], &truth), compare(&without.reconstructions[0], &truth));
    let (ate_m, ate_without_m) = (with.ate.expect("enough images").rmse, aligned.ate.expect("enough images").rmse);
    println!(
        "the fixture: scale error {:+.3} %, {metric}; ATE {ate_m:.5} m, without depth {ate_without_m:.5} m",
        100.0 * with.scale_error.expect("enough images")
    );
    assert!(with.scale_error.expect("enough images").abs() < 0.005);
    assert!(with.ate_rigid.expect("enough images").rmse_over_extent < 5e-3);
    // Both are drawn by half a pixel of noise: over seeds the one with depth is 0.8 to 1.1 times the other.
    assert!(ate_m < 1.2 * ate_without_m, "{ate_m} m, without depth {ate_without_m} m");
    // The stated uncertainty is believable: the scale is no further off than four times that.
    assert!(scale_error(&outcome, 0, &truth).abs() < 4.0 * metric.scale_relative_sigma.max(2e-4), "{metric:?}");
    // 3 % gross errors; those that stand beside another depth are refused as edges before.
    assert!((0.005..0.08).contains(&metric.outlier_share) && metric.biased_maps.is_empty(), "{metric:?}");
}

#[test]
fn every_component_is_metric_by_its_own_maps() {
    let noisy = |seed| DepthModel { share: 0.5, relative_noise: 0.02, seed, ..DepthModel::default() };
    let mut scene =
        with_depths(synth::Options { seed: 41, num_images: 12, num_points: 900, ..Default::default() }, &noisy(1));
    let small = scene.truth.clone();
    let other = synth::Options { kind: Kind::Street, seed: 42, num_images: 16, num_points: 1500, ..Default::default() };
    let large = scene.append(with_depths(other, &noisy(2)));
    let outcome = run(&scene.graph, &Options::default());
    assert_eq!(outcome.reconstructions.len(), 2);
    for (component, truth) in [&large, &small].into_iter().enumerate() {
        let metric = outcome.report.components[component].metric.as_ref().expect("metric");
        let error = scale_error(&outcome, component, truth);
        println!("component {component}: scale error {:+.3} %, {metric}", 100.0 * error);
        assert_eq!(metric.maps, truth.images.len());
        assert!(error.abs() < 0.01, "component {component}: {error}");
    }
    // One component without depth stays free beside one that has it.
    scene.graph.images[..12].iter_mut().for_each(|image| image.depths = None);
    let outcome = run(&scene.graph, &Options::default());
    assert!(outcome.report.components[0].metric.is_some() && outcome.report.components[1].metric.is_none());
    assert!(scale_error(&outcome, 0, &large).abs() < 0.01);
}

/// The same depths as lengths of rays, which is what the file then holds.
fn as_ray_lengths(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    for image in &mut scene.graph.images {
        let camera = &scene.graph.cameras[image.camera];
        let Some(depths) = &image.depths else { continue };
        let lengths = image.keypoints_px.iter().zip(depths.iter()).map(|(px, depth)| {
            let ray = camera.ray_from_pixel(*px)?;
            depth.map(|d| KeypointDepth { z_m: d.z_m / ray.z, ..d })
        });
        image.depths = Some(Arc::new(ImageDepths::new(lengths)));
    }
    scene
}

/// From maps on disk; exact intrinsics, so that nothing but the depths decides the scale.
fn from_maps(scene: &Scene, kind: DepthKind) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    write_depth_maps(scene, folder.path(), &MapFiles::default()).expect("written");
    let mut graph = scene.graph.clone();
    graph.images.iter_mut().for_each(|image| image.depths = None);
    let depth = DepthOptions { relative_sigma: 0.01, kind, ..Default::default() };
    attach_depths(&mut graph, folder.path(), None, &depth, &mut |_, _| true).expect("a folder");
    run(&graph, &Options { depth, intrinsics: Intrinsics::Fixed, ..Options::default() })
}

/// Median of the model's over the true depth, near the centre of the images and in their corners.
fn center_and_corners(outcome: &Outcome, scene: &Scene) -> [f64; 2] {
    let (model, truth) = (&outcome.reconstructions[0], scene.depth_m.as_ref().expect("kept"));
    let mut ratios = [Vec::new(), Vec::new()];
    for (point, o) in model.points.iter().flat_map(|point| point.observations.iter().map(move |o| (point, o))) {
        let image = &model.images[o.image as usize];
        let camera = &model.cameras[image.camera];
        let half = 0.5 * DVec2::new(camera.width_px as f64, camera.height_px as f64);
        let radius = (image.keypoints_px[o.keypoint as usize] - half).length() / half.x;
        let z = image.cam_from_world.transform_point(point.position).z;
        let true_z = truth[image.id as usize - 1][o.keypoint as usize];
        // Between the two there is neither; a mismatched keypoint has no depth.
        let zone = if radius < 0.4 { 0 } else { 1 };
        if !(0.4..0.8).contains(&radius) && !true_z.is_nan() {
            ratios[zone].push(z / true_z);
        }
    }
    ratios.map(|mut all| {
        assert!(all.len() > 50, "{} observations", all.len());
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    })
}

/// Lenses of 100° and more, maps of z-depths and of ray lengths. In a corner the two differ by a factor of two, so that one
/// taken for the other shows, and so does a pin on the wrong length.
#[test]
fn wide_lenses_have_no_corner_bias() {
    for model in [CameraModel::SimplePinhole, CameraModel::OpenCvFisheye] {
        let options = synth::Options {
            kind: Kind::Street,
            seed: 43,
            num_images: 10,
            num_points: 600,
            image_size_px: [1000, 1000],
            focal_ratio: 0.42,
            noise_px: 0.1,
            models: vec![model],
            ..Default::default()
        };
        let z = with_depths(options, &DepthModel::default());
        let rays = as_ray_lengths(&z);
        for (kind, scene) in [(DepthKind::Z, &z), (DepthKind::Ray, &rays)] {
            let outcome = from_maps(scene, kind);
            let (error, [center, corners]) = (scale_error(&outcome, 0, &z.truth), center_and_corners(&outcome, &z));
            println!(
                "{model:?}, {kind:?}: scale error {:+.4} %, centre {center:.5}, corners {corners:.5}",
                100.0 * error
            );
            assert!(error.abs() < 1e-3, "{model:?} {kind:?}: {error}");
            assert!((corners / center - 1.0).abs() < 1e-3, "{model:?} {kind:?}: {center} {corners}");
        }
        let mistaken = scale_error(&from_maps(&rays, DepthKind::Z), 0, &z.truth);
        assert!(mistaken.abs() > 0.02, "lengths of rays taken for z-depths change the scale by {mistaken} only");
    }
}
