//! Scenes of known size with depth maps that are right, wrong in places, or wrong altogether.

use std::sync::Arc;

use epipole_geometry::camera::{Camera, CameraModel};
use epipole_geometry::{Rigid3, Similarity3};
use epipole_optimize::positioning;
use epipole_scene::{Image, ImageDepths, KeypointDepth, Observation, Point, Reconstruction};
use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;

const IMAGES: usize = 12;
const POINTS: usize = 200;

/// A row of cameras before a deep field of points; the depth of the observation of `point` in `image` is `depth(image,
/// point, z)` where that is positive.
fn scene(mut depth: impl FnMut(usize, usize, f64) -> f64) -> Reconstruction {
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let camera = Camera::with_focal(1, CameraModel::SimplePinhole, 1000, 800, 400.0);
    let positions: Vec<DVec3> = (0..POINTS)
        .map(|_| {
            DVec3::new(random.random_range(-2.0..4.0), random.random_range(-2.0..2.0), random.random_range(2.0..8.0))
        })
        .collect();
    let images = (0..IMAGES).map(|i| {
        let pose = Rigid3::from_rotation_and_center(DQuat::IDENTITY, DVec3::new(0.2 * i as f64, 0.0, 0.0));
        let in_cam: Vec<DVec3> = positions.iter().map(|&p| pose.transform_point(p)).collect();
        let keypoints: Vec<DVec2> = in_cam.iter().map(|&p| camera.project(p).unwrap_or_default()).collect();
        let depths = in_cam.iter().enumerate().map(|(p, q)| {
            let z_m = depth(i, p, q.z);
            Some(KeypointDepth { z_m, relative_sigma: 0.05 })
        });
        Image {
            id: i as u32 + 1,
            name: format!("{i}.jpg"),
            camera: 0,
            cam_from_world: pose,
            keypoints_px: keypoints.into(),
            depths: Some(Arc::new(ImageDepths::new(depths))),
        }
    });
    let observe = |keypoint: usize| move |image| Observation { image, keypoint: keypoint as u32 };
    let points = positions.iter().enumerate().map(|(k, &position)| Point {
        id: k as u64 + 1,
        position,
        rgb: [0; 3],
        error_px: -1.0,
        observations: (0..IMAGES as u32).map(observe(k)).collect(),
    });
    Reconstruction {
        images: images.collect(),
        points: points.collect(),
        cameras: vec![camera],
        ..Reconstruction::default()
    }
}

fn extent(reconstruction: &Reconstruction) -> f64 {
    let centers: Vec<DVec3> = reconstruction.images.iter().map(|i| i.cam_from_world.center()).collect();
    centers[0].distance(centers[IMAGES - 1]) / (0.2 * (IMAGES - 1) as f64)
}

/// The scene in other units, judged.
fn begin(options: &Options, mut scene: Reconstruction) -> (Metric, Reconstruction, Option<String>) {
    scene.transform(&Similarity3 { scale: 3.7, rotation: DQuat::IDENTITY, translation: DVec3::ZERO });
    let mut metric = Metric::new(options, &scene.images);
    let doubt = metric.begin(&mut scene);
    (metric, scene, doubt)
}

#[test]
fn the_scale_survives_gross_errors_and_gaps() {
    let mut random = Pcg64Mcg::seed_from_u64(4);
    let depth = |_, _, z: f64| match random.random_range(0.0..1.0) {
        u if u < 0.5 => 0.0,
        u if u < 0.6 => random.random_range(0.5..20.0),
        _ => z * random.random_range(0.96..1.04),
    };
    let (metric, scene, doubt) = begin(&Options::default(), scene(depth));
    assert_eq!(doubt, None);
    assert!((extent(&scene) - 1.0).abs() < 0.01, "{}", extent(&scene));
    let report = metric.report(&scene).expect("metric");
    assert!((0.4..0.6).contains(&report.observations_with_depth_share), "{report:?}");
    assert!((0.1..0.3).contains(&report.outlier_share) && report.biased_maps.is_empty(), "{report:?}");
    assert!(report.scale_relative_sigma < 0.01 && report.median_absolute_relative_residual < 0.04, "{report:?}");
    assert!(report.to_string().starts_with("in metres"), "{report}");
}

#[test]
fn a_biased_map_gets_a_scale_of_its_own() {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let depth = |image, _, z: f64| z * random.random_range(0.97..1.03) * if image == 4 { 1.1 } else { 1.0 };
    let (metric, scene, _) = begin(&Options::default(), scene(depth));
    assert!((extent(&scene) - 1.0).abs() < 0.005, "{}", extent(&scene));
    assert_eq!(metric.report(&scene).expect("metric").biased_maps, ["4.jpg"]);
    assert!((metric.maps[4].depth_m(1.1).expect("positive") - 1.0).abs() < 0.005);
    assert_eq!(metric.maps[5], MapFit::default());
    let observations = scene.points.iter().flat_map(|p| p.observations.iter().copied());
    let rows = metric.rows(&scene, observations).expect("bundle adjustment sees depths");
    assert!(rows.weight.iter().all(|&w| w > 0.0) && rows.inverse.len() == IMAGES * POINTS);
}

#[test]
fn depths_of_another_scene_are_refused() {
    let mut random = Pcg64Mcg::seed_from_u64(6);
    let (metric, scene, doubt) = begin(&Options::default(), scene(|_, _, _| random.random_range(0.2..20.0)));
    assert!(doubt.expect("refused").contains("contradict the images"));
    assert!(!metric.is_metric() && !metric.pins_rays() && metric.report(&scene).is_none());
    assert!((extent(&scene) - 3.7).abs() < 1e-12, "the scale is left alone");
    assert_eq!(metric.rows(&scene, std::iter::empty()), None);
}

#[test]
fn too_few_depths_and_none_at_all() {
    let (metric, _, doubt) = begin(&Options::default(), scene(|i, p, z| if i == 0 && p < 5 { z } else { 0.0 }));
    assert!(doubt.expect("refused").contains("5 observations") && !metric.is_metric());
    let (metric, _, doubt) = begin(&Options::default(), scene(|_, _, _| 0.0));
    assert!(doubt.is_none() && !metric.is_metric());
    let off = Options { stages: DepthStages::Off, ..Options::default() };
    let (metric, _, doubt) = begin(&off, scene(|_, _, z| z));
    assert!(doubt.is_none() && !metric.is_metric() && !metric.pins_rays());
}

#[test]
fn learned_maps_have_a_scale_and_a_shift() {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    // Inverse depths with a scale of ±20 % and a shift of each map, and 1 % noise.
    let maps: Vec<(f64, f64)> =
        (0..IMAGES).map(|i| (0.8 + 0.4 * i as f64 / (IMAGES - 1) as f64, 0.02 * ((i % 3) as f64 - 1.0))).collect();
    let depth = |image: usize, _, z: f64| maps[image].0 / (1.0 / z - maps[image].1) * random.random_range(0.99..1.01);
    let options = Options { affine: true, ..Options::default() };
    let (metric, scene, doubt) = begin(&options, scene(depth));
    assert_eq!(doubt, None);
    assert!((extent(&scene) - 1.0).abs() < 0.1, "the consensus of the maps: {}", extent(&scene));
    let samples = maps::samples(&scene);
    for (map, samples) in metric.maps.iter().zip(&samples) {
        let worst = samples.iter().map(|s| (map.depth_m(s.measured.z_m).unwrap_or(f64::NAN) / s.z - 1.0).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 0.06, "{worst} {map:?}");
    }
}

#[test]
fn the_paper_pulls_what_has_no_depth_to_infinity() {
    let options = Options { weight: DepthWeight::Paper, ..Options::default() };
    let (metric, scene, _) = begin(&options, scene(|i, _, z| if i < 6 { z } else { 0.0 }));
    let observations: Vec<Observation> = scene.points.iter().flat_map(|p| p.observations.iter().copied()).collect();
    let rows = metric.rows(&scene, observations.iter().copied()).expect("rows");
    assert!(rows.weight.iter().all(|&w| w == 0.1));
    for (k, o) in observations.iter().enumerate() {
        assert_eq!(rows.inverse[k] < 1e-7, o.image >= 6);
    }
}

#[test]
fn the_length_of_a_corner_ray_is_more_than_its_depth() {
    let camera = Camera::with_focal(1, CameraModel::SimplePinhole, 1000, 1000, 400.0);
    let depth = KeypointDepth { z_m: 2.0, relative_sigma: 0.05 };
    let corner = camera.ray_from_pixel(DVec2::ZERO).expect("a ray");
    let length = ray_length_m(&camera, corner, depth).expect("forward");
    assert!((length - 2.0 * (1.0f64 + 2.0 * 1.25 * 1.25).sqrt()).abs() < 1e-12, "{length}");
    assert_eq!(ray_length_m(&camera, -corner, depth), None);
}

#[test]
fn wide_angles_have_no_corner_bias() {
    let scene = scene(|_, _, z| z);
    let extent_with = |length_m: &dyn Fn(&Camera, DVec3, KeypointDepth) -> f64| {
        let camera = &scene.cameras[0];
        let mut problem = positioning::Problem {
            centers: vec![DVec3::ZERO; IMAGES],
            points: vec![DVec3::ZERO; POINTS],
            image_weight: vec![1.0; IMAGES],
            track_start: vec![0],
            ..positioning::Problem::default()
        };
        let mut pins = Vec::new();
        for point in &scene.points {
            for &o in &point.observations {
                let px = scene.images[o.image as usize].keypoints_px[o.keypoint as usize];
                // All cameras look along +z of the world.
                let ray = camera.ray_from_pixel(px).expect("a pinhole camera");
                pins.push(1.0 / length_m(camera, ray, depth_of(&scene, o).expect("every keypoint has one")));
                problem.observation_image.push(o.image);
                problem.observation_ray.push(ray);
            }
            problem.track_start.push(pins.len() as u32);
        }
        problem.pinned_scale = Some(pins);
        positioning::solve(&mut problem, &positioning::Options::default(), &mut ()).expect("a good problem");
        problem.centers[0].distance(problem.centers[IMAGES - 1]) / (0.2 * (IMAGES - 1) as f64)
    };
    let by_ray = extent_with(&|camera, ray, depth| ray_length_m(camera, ray, depth).expect("forward"));
    assert!((by_ray - 1.0).abs() < 1e-5, "{by_ray}");
    // What pinning unit rays at 1/z would do, as the published code does.
    let by_z = extent_with(&|_, _, depth| depth.z_m);
    assert!((by_z - 1.0).abs() > 0.03, "{by_z}");
}
