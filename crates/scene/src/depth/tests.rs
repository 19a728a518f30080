//! Sampling and registering on maps whose depths are known everywhere: planes, and planes in front of planes.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;

use super::*;

/// `n · p = 1` for a point `p` of the plane in the camera frame.
const SLANTED: DVec3 = DVec3::new(0.15, -0.1, 0.4);

fn camera(model: CameraModel, width_px: u64, height_px: u64, focal_px: f64) -> Camera {
    Camera::with_focal(1, model, width_px, height_px, focal_px)
}

/// Depths of a plane as a camera of the given size sees it.
fn plane_map(camera: &Camera, width: usize, height: usize, kind: DepthKind, plane: DVec3) -> DepthMap {
    let scale = DVec2::new(camera.width_px as f64 / width as f64, camera.height_px as f64 / height as f64);
    let value = |row: usize, column: usize| {
        let px = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * scale;
        let ray = camera.ray_from_pixel(px).expect("a ray");
        let point = ray / plane.dot(ray);
        (if kind == DepthKind::Z { point.z } else { point.length() }) as f32
    };
    let values = (0..height).flat_map(|row| (0..width).map(move |column| (row, column))).map(|(r, c)| value(r, c));
    DepthMap::new(width, height, values.collect()).expect("a map")
}

fn true_z(camera: &Camera, px: DVec2, plane: DVec3) -> f64 {
    let ray = camera.ray_from_pixel(px).expect("a ray");
    ray.z / plane.dot(ray)
}

fn grid_px(camera: &Camera, steps: u32) -> impl Iterator<Item = DVec2> {
    let size = DVec2::new(camera.width_px as f64, camera.height_px as f64);
    let at = move |i: u32| f64::from(i) / f64::from(steps);
    (0..=steps).flat_map(move |y| (0..=steps).map(move |x| DVec2::new(at(x), at(y)) * size))
}

#[test]
fn planes_are_exact_at_any_resolution_and_up_to_the_border() {
    let options = DepthOptions { max_jump: 0.2, ..Default::default() };
    let pinhole = camera(CameraModel::Pinhole, 64, 48, 60.0);
    for (width, height) in [(64, 48), (32, 24), (128, 96), (50, 48)] {
        for kind in [DepthKind::Z, DepthKind::Ray] {
            let map = plane_map(&pinhole, width, height, kind, SLANTED);
            let sampler = DepthSampler::new(&map, kind, &pinhole, &options);
            for px in grid_px(&pinhole, 37) {
                let found = sampler.sample(px).expect("a depth");
                let truth = true_z(&pinhole, px, SLANTED);
                assert!((found.z_m / truth - 1.0).abs() < 1e-6, "{kind:?} {width}×{height} at {px}: {found:?}");
                assert_eq!(found.relative_sigma, options.relative_sigma);
            }
        }
    }
}

/// solver.md §3.1: taking ray lengths for z-depths, or the reverse, is wrong by 23 % in the corners of a 60° image.
#[test]
fn wide_cameras_have_no_corner_bias() {
    let wide = camera(CameraModel::OpenCvFisheye, 640, 480, 320.0);
    let map = plane_map(&wide, 640, 480, DepthKind::Ray, DVec3::Z);
    let options = DepthOptions::default();
    let sampler = DepthSampler::new(&map, DepthKind::Ray, &wide, &options);
    for px in grid_px(&wide, 23).filter(|px| px.min_element() > 1.0) {
        assert!((sampler.sample(px).expect("a depth").z_m - 1.0).abs() < 1e-4, "{px}");
    }
    let as_z = DepthSampler::new(&map, DepthKind::Z, &wide, &options);
    assert!(as_z.sample(DVec2::new(2.0, 2.0)).expect("a depth").z_m > 1.5);
}

/// Left half at 1 m, right half at `far`, one hole.
fn step_map(far: f32) -> DepthMap {
    let mut values: Vec<f32> = (0..16 * 12).map(|i| if i % 16 < 8 { 1.0 } else { far }).collect();
    values[5 * 16 + 3] = 0.0;
    DepthMap::new(16, 12, values).expect("a map")
}

#[test]
fn edges_holes_and_the_outside_are_refused() {
    let pinhole = camera(CameraModel::SimplePinhole, 16, 12, 16.0);
    let narrow = DepthOptions { edge_margin_px: 0, ..Default::default() };
    let map = step_map(2.0);
    let at = |options: &DepthOptions, x: f64, y: f64| {
        DepthSampler::new(&map, DepthKind::Z, &pinhole, options).sample(DVec2::new(x, y)).map(|depth| depth.z_m)
    };
    // Between the centres of columns 7 and 8.
    assert_eq!(at(&narrow, 8.0, 9.0), Err(Refusal::Edge));
    assert_eq!((at(&narrow, 7.4, 9.0), at(&narrow, 8.6, 9.0)), (Ok(1.0), Ok(2.0)));
    let margin = DepthOptions::default();
    assert_eq!((at(&margin, 7.4, 9.0), at(&margin, 8.6, 9.0)), (Err(Refusal::Edge), Err(Refusal::Edge)));
    assert_eq!((at(&margin, 6.4, 9.0), at(&margin, 9.6, 9.0)), (Ok(1.0), Ok(2.0)));
    // The hole is pixel (3, 5), with its centre at (3.5, 5.5).
    assert_eq!((at(&margin, 3.2, 5.2), at(&margin, 4.2, 6.2)), (Err(Refusal::NoValue), Err(Refusal::NoValue)));
    assert_eq!(at(&margin, 2.4, 5.5), Ok(1.0), "a hole beside the four nearest is no edge");
    for (x, y) in [(-0.1, 3.0), (16.1, 3.0), (3.0, -0.1), (3.0, 12.1), (f64::NAN, 3.0), (f64::INFINITY, 3.0)] {
        assert_eq!(at(&margin, x, y), Err(Refusal::OutsideMap), "({x}, {y})");
    }
    assert_eq!((at(&margin, 0.0, 0.0), at(&margin, 16.0, 12.0)), (Ok(1.0), Ok(2.0)));
    let near = DepthOptions { max_m: 1.5, ..Default::default() };
    assert_eq!(at(&near, 12.0, 3.0), Err(Refusal::TooFar));
    let mut counts = RefusalCounts::default();
    let sampler = DepthSampler::new(&map, DepthKind::Z, &pinhole, &margin);
    let depths = sampler.sample_all(&[DVec2::new(8.0, 9.0), DVec2::new(2.0, 2.0), DVec2::new(-1.0, 0.0)], &mut counts);
    assert_eq!((depths.num_known(), counts.edge, counts.outside_map), (1, 1, 1));
}

#[test]
fn confidence_widens_and_refuses() {
    let pinhole = camera(CameraModel::SimplePinhole, 3, 1, 3.0);
    let map = DepthMap::new(3, 1, vec![1.0; 3]).expect("a map").with_confidence(vec![1.0, 0.25, 0.0]).expect("three");
    let options = DepthOptions { edge_margin_px: 0, ..Default::default() };
    let sampler = DepthSampler::new(&map, DepthKind::Z, &pinhole, &options);
    let sigma = sampler.sample(DVec2::new(1.0, 0.5)).expect("a depth").relative_sigma;
    assert!((sigma - 2.0 * options.relative_sigma).abs() < 1e-12, "a quarter of the weight");
    assert_eq!(sampler.sample(DVec2::new(2.0, 0.5)), Err(Refusal::LowConfidence));
}

#[test]
fn a_single_pixel_is_a_map() {
    let pinhole = camera(CameraModel::SimplePinhole, 100, 100, 100.0);
    let map = DepthMap::new(1, 1, vec![3.0]).expect("a map");
    let options = DepthOptions::default();
    let sampler = DepthSampler::new(&map, DepthKind::Z, &pinhole, &options);
    assert_eq!(sampler.sample(DVec2::new(99.0, 1.0)).map(|d| d.z_m), Ok(3.0));
}

/// A plane seen by a depth camera with other intrinsics, turned and moved, must be the plane the colour camera sees.
#[test]
fn a_registered_plane_is_where_it_was() {
    let depth_camera = camera(CameraModel::Pinhole, 80, 60, 73.0);
    let color_camera = Camera {
        params: vec![130.0, 128.0, 79.0, 61.0, -0.05, 0.01, 1e-3, -1e-3],
        ..camera(CameraModel::OpenCv, 160, 120, 130.0)
    };
    let color_from_depth = Rigid3::new(DQuat::from_rotation_y(0.02), DVec3::new(0.025, -0.01, 0.005));
    // n·p = 1 in the depth frame is (R n)·q = 1 + (R n)·t in the colour frame.
    let turned = color_from_depth.rotation * SLANTED;
    let seen = turned / (1.0 + turned.dot(color_from_depth.translation));
    let options = DepthOptions { max_jump: 0.2, ..Default::default() };
    for kind in [DepthKind::Z, DepthKind::Ray] {
        let map = plane_map(&depth_camera, 80, 60, kind, SLANTED);
        let map = register(&map, kind, &depth_camera, &color_from_depth, &color_camera, 0.2).expect("drawn");
        assert!(map.width() < 160, "no finer than the map");
        let sampler = DepthSampler::new(&map, DepthKind::Z, &color_camera, &options);
        let depth_from_color = color_from_depth.inverse();
        for px in grid_px(&color_camera, 40) {
            let truth = true_z(&color_camera, px, seen);
            let ray = color_camera.ray_from_pixel(px).expect("a ray");
            let on_map = depth_camera.project(depth_from_color.transform_point(ray * (truth / ray.z)));
            let inside = |px: DVec2| px.x > 2.0 && px.y > 2.0 && px.x < 78.0 && px.y < 58.0;
            match sampler.sample(px) {
                // Triangles are flat on the drawn image, which distortion bends by a few per mille of a pixel.
                Ok(depth) => assert!((depth.z_m / truth - 1.0).abs() < 2e-5, "{kind:?} at {px}: {depth:?}"),
                Err(refusal) => assert!(!on_map.is_some_and(inside), "{kind:?} at {px}: {refusal:?}"),
            }
        }
    }
}

/// A near square before a far wall, seen from the side: what it hides from the depth camera stays unknown, and where both
/// are drawn the near one wins.
#[test]
fn the_nearer_surface_hides_the_farther() {
    let both = camera(CameraModel::SimplePinhole, 100, 100, 100.0);
    let is_near = |column: usize, row: usize| (40..60).contains(&column) && (40..60).contains(&row);
    let values = (0..100 * 100).map(|i| if is_near(i % 100, i / 100) { 1.0 } else { 4.0 });
    let map = DepthMap::new(100, 100, values.collect()).expect("a map");
    // The colour camera sits 0.2 m to the right: the square moves left by 20 px, the wall by 5 px.
    let color_from_depth = Rigid3::new(DQuat::IDENTITY, DVec3::new(-0.2, 0.0, 0.0));
    let drawn = register(&map, DepthKind::Z, &both, &color_from_depth, &both, 0.05).expect("drawn");
    assert_eq!(drawn.get(30, 50), Some(1.0), "the square, over the wall behind it");
    assert_eq!(drawn.get(48, 50), None, "the wall that the square hid");
    assert_eq!(drawn.get(70, 50), Some(4.0));
    assert_eq!(drawn.get(10, 50), Some(4.0));
    assert_eq!(drawn.get(97, 50), None, "beyond the map");
}

#[test]
fn impossible_cameras_are_refused() {
    let map = DepthMap::new(2, 2, vec![1.0; 4]).expect("a map");
    let good = camera(CameraModel::SimplePinhole, 2, 2, 2.0);
    for size in [0, 1 << 40] {
        let bad = Camera { width_px: size, height_px: size, ..good.clone() };
        assert!(register(&map, DepthKind::Z, &good, &Rigid3::IDENTITY, &bad, 0.1).is_err(), "{size}");
    }
}

proptest! {
    #[test]
    fn nothing_panics(
        width in 1usize..5,
        height in 1usize..5,
        bits in proptest::collection::vec(any::<u32>(), 16),
        x in -3.0f64..8.0,
        y in -3.0f64..8.0,
        focal_px in 0.1f64..100.0,
        shift in -2.0f64..2.0,
        is_ray in any::<bool>(),
    ) {
        let values = bits.iter().take(width * height).map(|&b| f32::from_bits(b)).collect();
        let map = DepthMap::new(width, height, values).expect("a map");
        let seen_by = camera(CameraModel::SimpleRadial, 4, 4, focal_px);
        let kind = if is_ray { DepthKind::Ray } else { DepthKind::Z };
        let options = DepthOptions { max_jump: 1e9, max_m: f64::MAX, ..Default::default() };
        if let Ok(depth) = DepthSampler::new(&map, kind, &seen_by, &options).sample(DVec2::new(x, y)) {
            prop_assert!(!depth.z_m.is_nan());
        }
        let moved = Rigid3::new(DQuat::from_rotation_x(shift), DVec3::splat(shift));
        let drawn = register(&map, kind, &seen_by, &moved, &seen_by, 1e9).expect("a small image");
        prop_assert!(drawn.values_m().iter().all(|v| v.is_nan() || (*v > 0.0 && v.is_finite())));
    }
}
