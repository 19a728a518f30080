//! Triangulation of points whose position is known.

use glam::{DQuat, DVec3};

use super::*;

/// Random numbers in −1..1, the same on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Cameras on an arc around the origin that look at it, and a point near the origin.
fn scene(random: &mut Random, n: usize) -> (Vec<Rigid3>, DVec3) {
    let poses = (0..n).map(|i| {
        let turn = DQuat::from_rotation_y(0.15 * i as f64) * DQuat::from_rotation_x(0.05 * random.next());
        Rigid3::from_rotation_and_center(turn.conjugate(), turn * DVec3::new(0.0, 0.0, -5.0))
    });
    (poses.collect(), random.vector())
}

fn view(pose: &Rigid3, point: DVec3, noise: DVec3) -> View {
    View::new(pose, (pose.transform_point(point).normalize() + noise).normalize())
}

#[test]
fn exact_bearings_give_the_exact_point() {
    let mut random = Random(1);
    for n in 2..12 {
        let (poses, point) = scene(&mut random, n);
        let views: Vec<_> = poses.iter().map(|p| view(p, point, DVec3::ZERO)).collect();
        let error = |p: Option<DVec3>| p.expect("a point").distance(point);
        assert!(error(triangulate_multi_view(&views)) < 1e-12);
        assert!(error(triangulate_midpoint(&views[0], &views[1])) < 1e-12);
        let rays = [0, 1].map(|i: usize| poses[i].transform_point(point).normalize());
        assert!(error(triangulate_two_view_dlt(&poses[0], &poses[1], rays[0], rays[1])) < 1e-12);
        let robust = estimate_triangulation(&views, &RobustOptions::default(), 0).expect("a point");
        assert!(robust.position.distance(point) < 1e-12 && robust.inlier_mask == vec![true; n]);
    }
}

#[test]
fn the_frame_and_scale_of_the_world_do_not_matter() {
    let mut random = Random(2);
    let (poses, point) = scene(&mut random, 5);
    let views: Vec<_> = poses.iter().map(|p| view(p, point, 1e-3 * random.vector())).collect();
    let here = triangulate_multi_view(&views).expect("a point");
    let (offset, scale) = (DVec3::new(3000.0, -200.0, 50.0), 1e-4);
    let moved: Vec<_> = views.iter().map(|v| View { center: scale * (v.center + offset), ..*v }).collect();
    let there = triangulate_multi_view(&moved).expect("a point") / scale - offset;
    assert!(here.distance(there) < 1e-9, "{here} {there}");
    assert!(here.distance(point) < 0.02);
}

#[test]
fn parallel_rays_and_single_centres_have_no_point() {
    let first = View { center: DVec3::ZERO, ray_in_world: DVec3::Z };
    let parallel = View { center: DVec3::X, ray_in_world: DVec3::Z };
    let same_place = View { center: DVec3::ZERO, ray_in_world: DVec3::X };
    assert_eq!(triangulate_midpoint(&first, &parallel), None);
    assert_eq!(triangulate_multi_view(&[first, same_place]), None);
    assert_eq!(triangulate_multi_view(&[first]), None);
    assert_eq!(triangulate_multi_view(&[]), None);
    assert_eq!(estimate_triangulation(&[first, parallel], &RobustOptions::default(), 0), None);
    assert_eq!(estimate_triangulation(&[first, same_place], &RobustOptions::default(), 0), None);
    let nan = View { center: DVec3::NAN, ray_in_world: DVec3::Z };
    assert_eq!(estimate_triangulation(&[first, nan, parallel], &RobustOptions::default(), 0), None);
}

#[test]
fn points_behind_or_at_too_small_an_angle_are_refused() {
    let point = DVec3::new(0.0, 0.0, 4.0);
    let at = |x: f64, sign: f64| {
        let center = DVec3::new(x, 0.0, 0.0);
        View { center, ray_in_world: sign * (point - center).normalize() }
    };
    let options = RobustOptions::default();
    assert!(estimate_triangulation(&[at(0.0, 1.0), at(1.0, 1.0)], &options, 0).is_some());
    assert_eq!(estimate_triangulation(&[at(0.0, -1.0), at(1.0, -1.0)], &options, 0), None);
    // 0.04 at a distance of 4 is 0.57°.
    assert_eq!(estimate_triangulation(&[at(0.0, 1.0), at(0.04, 1.0)], &options, 0), None);
}

#[test]
fn outliers_are_found_with_few_and_with_many_views() {
    let mut random = Random(3);
    for n in [6, 14, 40, 200] {
        let (mut poses, _) = scene(&mut random, n.min(20));
        poses = (0..n).map(|i| poses[i % poses.len()]).collect();
        let point = 0.5 * random.vector();
        let outlier = |i: usize| i % 3 == 1;
        let views: Vec<_> = (0..n)
            .map(|i| {
                let noise = 2e-4 * random.vector();
                // 0.2 across the line of sight is 11° and more.
                let aside =
                    0.2 * random.vector().normalize().cross(poses[i].transform_point(point).normalize()).normalize();
                view(&poses[i], point, if outlier(i) { aside } else { noise })
            })
            .collect();
        let options = RobustOptions { max_angular_error_rad: 0.5f64.to_radians(), ..Default::default() };
        let found = estimate_triangulation(&views, &options, 7).expect("a point");
        assert!(found.position.distance(point) < 5e-3, "{n}: {} {point}", found.position);
        for i in 0..n {
            assert_eq!(found.inlier_mask[i], !outlier(i), "{n} {i}");
        }
        assert_eq!(estimate_triangulation(&views, &options, 7), Some(found), "the same seed, the same result");
    }
}

#[test]
fn refinement_reaches_the_least_angular_error() {
    let mut random = Random(4);
    let (poses, point) = scene(&mut random, 6);
    let views: Vec<_> = poses.iter().map(|p| view(p, point, 3e-3 * random.vector())).collect();
    let cost = |x: DVec3| views.iter().map(|v| v.sine_squared(x)).sum::<f64>();
    let start = triangulate_multi_view(&views).expect("a point") + 0.1 * DVec3::ONE;
    let refined = refine_point(&views, start, 20);
    assert!(cost(refined) < cost(start));
    for step in [DVec3::X, DVec3::Y, DVec3::Z] {
        for size in [1e-4, -1e-4] {
            assert!(cost(refined + size * step) > cost(refined) * (1.0 - 1e-9));
        }
    }
    assert_eq!(refine_point(&views[..1], point, 5), point, "one ray leaves the depth free");
}

#[test]
fn angles_fold_at_a_right_angle() {
    let angle = |a: DVec3, b: DVec3| triangulation_angle_rad(a, b, DVec3::ZERO).to_degrees();
    assert!((angle(DVec3::X, DVec3::Y) - 90.0).abs() < 1e-12);
    assert!((angle(DVec3::X, DVec3::new(-1.0, 1.0, 0.0)) - 45.0).abs() < 1e-12);
    assert!(angle(DVec3::X, -DVec3::X) < 1e-12);
    assert_eq!(angle(DVec3::ZERO, DVec3::X), 0.0);
}

/// Microseconds per track; `cargo test --release -p epipole-geometry -- --ignored --nocapture speed_of_triangulation`.
#[test]
#[ignore = "a measurement, not a check"]
fn speed_of_triangulation() {
    let mut random = Random(5);
    for (n, outliers) in [(2, 0), (3, 0), (6, 0), (6, 1), (15, 0), (15, 3), (60, 20)] {
        let (poses, point) = scene(&mut random, n);
        let views: Vec<_> =
            (0..n).map(|i| view(&poses[i], point, random.vector() * if i < outliers { 0.3 } else { 1e-3 })).collect();
        let start = std::time::Instant::now();
        let found =
            (0..1000).filter(|&seed| estimate_triangulation(&views, &RobustOptions::default(), seed).is_some()).count();
        println!("{n} views, {outliers} outliers: {:.2} µs ({found} found)", start.elapsed().as_secs_f64() * 1e3);
    }
}
