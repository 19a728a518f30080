//! Pinned scales: depths make the world metric.

use super::scene::{KINDS, Kind, Noise, Random, Scene, aligned_error, scene, scene_of};
use crate::positioning::{Options, solve};

/// Pins the given share of the observations to the true length times `1 + noise · N(0, 1)`.
pub(crate) fn pin(scene: &mut Scene, share: f64, noise: f64) {
    let mut random = Random(21);
    let mut pins = vec![0.0; scene.problem.observations()];
    for point in 0..scene.problem.points.len() {
        for o in scene.problem.track(point) {
            let length = (scene.points[point] - scene.centers[scene.problem.observation_image[o] as usize]).length();
            if random.uniform(0.0, 1.0) < share {
                pins[o] = 1.0 / (length * (1.0 + noise * random.normal()).max(0.3));
            }
        }
    }
    scene.problem.pinned_scale = Some(pins);
}

/// Says that every other pin is uncertain, by up to a third.
#[cfg(feature = "gpu")]
pub(crate) fn doubt(scene: &mut Scene) {
    let sigma = (0..scene.problem.observations()).map(|o| if o % 2 == 0 { 0.05 } else { (o % 7) as f64 / 20.0 });
    scene.problem.pin_sigma = Some(sigma.collect());
}

/// Size of the found camera path over the true one.
pub(crate) fn scale(scene: &Scene) -> f64 {
    let spread = |v: &[glam::DVec3]| {
        let mean = v.iter().sum::<glam::DVec3>() / v.len() as f64;
        let mut distances: Vec<f64> = v.iter().map(|c| (*c - mean).length()).collect();
        distances.sort_by(f64::total_cmp);
        distances[distances.len() / 2]
    };
    spread(&scene.problem.centers) / spread(&scene.centers)
}

#[test]
fn all_pinned_is_linear_and_metric() {
    for kind in KINDS {
        let mut scene = scene(kind, Noise::default(), 1);
        pin(&mut scene, 1.1, 0.0);
        let report = solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
        assert!((scale(&scene) - 1.0).abs() < 1e-5, "{kind:?} {}", scale(&scene));
        assert!(aligned_error(&scene.problem.centers, &scene.centers).1 < 1e-5);
        assert!(report.kept().convex.solves <= 3, "exact pins: the first solve is the answer");
        assert!((report.metric_scale_correction.unwrap() - 1.0).abs() < 1e-5);
    }
}

#[test]
fn some_noisy_depths_give_the_scale_and_steady_an_open_street() {
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 1.0, outliers: 0.1 };
    let mut free = scene(Kind::Street, noise, 3);
    solve(&mut free.problem, &Options::default(), &mut ()).unwrap();
    let mut pinned = scene(Kind::Street, noise, 3);
    pin(&mut pinned, 0.3, 0.1);
    solve(&mut pinned.problem, &Options::default(), &mut ()).unwrap();
    let (without, _) = aligned_error(&free.problem.centers, &free.centers);
    let (with, _) = aligned_error(&pinned.problem.centers, &pinned.centers);
    println!("street without depths {without:.4}, with {with:.4}, scale {:.4}", scale(&pinned));
    assert!(with < 0.03 && with < 0.5 * without, "{with} {without}");
    assert!((scale(&pinned) - 1.0).abs() < 0.03, "{}", scale(&pinned));
}

/// The case of `reference/solver.md` §3.3 that ray directions do not determine: an open street of 300 cameras.
#[test]
fn a_long_street_stands_by_its_depths() {
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 1.0, outliers: 0.1 };
    let mut free = scene_of(Kind::Street, noise, 3, 300);
    solve(&mut free.problem, &Options::default(), &mut ()).unwrap();
    let mut pinned = scene_of(Kind::Street, noise, 3, 300);
    pin(&mut pinned, 0.3, 0.1);
    pinned.problem.pin_sigma = Some(vec![0.1; pinned.problem.observations()]);
    solve(&mut pinned.problem, &Options::default(), &mut ()).unwrap();
    let (without, _) = aligned_error(&free.problem.centers, &free.centers);
    let (with, _) = aligned_error(&pinned.problem.centers, &pinned.centers);
    println!("street of 300 without depths {without:.4}, with {with:.4}, scale {:.4}", scale(&pinned));
    assert!(with < 0.01 && with < 0.2 * without, "{with} {without}");
    assert!((scale(&pinned) - 1.0).abs() < 0.03, "{}", scale(&pinned));
}

#[test]
fn an_uncertain_pin_gives_way_to_the_certain() {
    let mut scene = scene(Kind::Orbit, Noise::default(), 4);
    pin(&mut scene, 1.1, 0.0);
    let observations = scene.problem.observations();
    let pins = scene.problem.pinned_scale.as_mut().unwrap();
    // Every other pin is 10 % short, and says that it may be.
    pins.iter_mut().step_by(2).for_each(|pin| *pin *= 1.1);
    let sigma = (0..observations).map(|o| if o % 2 == 0 { 1.0 } else { 0.001 }).collect();
    let mut equal = scene.problem.clone();
    scene.problem.pin_sigma = Some(sigma);
    solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
    let known = (scale(&scene) - 1.0).abs();
    std::mem::swap(&mut scene.problem, &mut equal);
    solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
    let unknown = (scale(&scene) - 1.0).abs();
    assert!(known < 0.005 && known < 0.5 * unknown, "{known} {unknown}");
}
