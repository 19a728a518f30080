//! Bad observations, broken graphs, garbage: an answer or a typed error, never a panic.

use glam::DVec3;

use super::scene::{KINDS, Kind, Noise, Random, aligned_error, garbage, scene};
use crate::lm::{IterationRecord, Observer, Termination};
use crate::positioning::{Grade, Options, Start, Warning, solve};

#[test]
fn rays_that_point_backwards_are_seen_and_survived() {
    for kind in KINDS {
        let mut scene = scene(kind, Noise { ray_rad: 1e-3, ..Noise::default() }, 7);
        let observations = scene.problem.observations();
        (0..observations).step_by(25).for_each(|o| scene.problem.observation_ray[o] *= -1.0);
        let report = solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
        let (middle, _) = aligned_error(&scene.problem.centers, &scene.centers);
        assert!(middle < 0.02, "{kind:?} {middle}");
        let behind = report.kept().quality.behind_share;
        assert!((0.02..0.06).contains(&behind), "{kind:?}: 4 % point backwards, {behind} found");
        let kept = &report.kept().lm;
        assert!(kept.active < observations, "observations at the bound do not pull");
    }
}

#[test]
fn a_hopeless_scene_is_retried_and_reported() {
    let noise = Noise { ray_rad: 1e-3, rotation_deg: 5.0, outliers: 0.75 };
    let mut scene = scene(Kind::Facade, noise, 8);
    let report = solve(&mut scene.problem, &Options::default(), &mut ()).unwrap();
    let starts: Vec<Start> = report.attempts.iter().map(|attempt| attempt.start).collect();
    assert_eq!(starts, [Start::EqualScales, Start::Lud, Start::Clipped]);
    assert!(report.attempts[1].convex.solves > 5);
    assert_eq!(report.kept().quality.grade(), Grade::Suspicious);
    assert!(report.warnings.iter().any(|w| matches!(w, Warning::Suspicious { .. })));
    assert!(report.warnings[0].to_string().contains("%"));
    let (a, b) = (&report.attempts[0], &report.attempts[1]);
    let cheaper = usize::from(b.lm.final_cost < a.lm.final_cost);
    assert!(report.chosen == cheaper || report.chosen == 2);
    let mut once = super::scene::scene(Kind::Facade, noise, 8).problem;
    let report = solve(&mut once, &Options { retry: false, ..Options::default() }, &mut ()).unwrap();
    assert_eq!(report.attempts.len(), 1);
}

#[test]
fn separate_groups_and_lonely_images_are_named() {
    let a = scene(Kind::Orbit, Noise { ray_rad: 1e-3, ..Noise::default() }, 1);
    let b = scene(Kind::Facade, Noise { ray_rad: 1e-3, ..Noise::default() }, 2);
    let mut problem = a.problem.clone();
    // Image 50 sees nothing; the facade's images follow; image 101 sees one point that nobody else sees.
    let shift = 51;
    problem.image_weight.resize(102, 1.0);
    problem.centers.resize(102, DVec3::ZERO);
    problem.observation_image.extend(b.problem.observation_image.iter().map(|i| i + shift));
    problem.observation_ray.extend(&b.problem.observation_ray);
    let offset = a.problem.observations() as u32;
    problem.track_start.extend(b.problem.track_start[1..].iter().map(|start| start + offset));
    problem.observation_image.push(101);
    problem.observation_ray.push(DVec3::Z);
    let end = problem.observations() as u32;
    problem.track_start.extend([end, end]);
    problem.points.resize(problem.track_start.len() - 1, DVec3::ZERO);
    let report = solve(&mut problem, &Options::default(), &mut ()).unwrap();
    assert_eq!(report.components.len(), 2);
    assert_eq!(report.components[0], (0..50).collect::<Vec<u32>>());
    assert_eq!(report.components[1], (51..101).collect::<Vec<u32>>());
    assert_eq!(report.unplaced_images, [50, 101]);
    assert_eq!((report.single_view_points, report.unseen_points), (1, 1));
    assert!(report.warnings.contains(&Warning::Disconnected { components: 2, images_outside: 50 }));
    assert!(report.warnings.contains(&Warning::ImagesWithoutTracks { count: 2 }));
    // Each group is right by itself.
    assert!(aligned_error(&problem.centers[..50], &a.centers).0 < 0.01);
    assert!(aligned_error(&problem.centers[51..101], &b.centers).0 < 0.02);
    assert!(problem.centers.iter().chain(&problem.points).all(|p| p.is_finite()));
}

#[test]
fn an_observer_sees_every_iteration_and_may_stop() {
    struct Few(Vec<usize>);
    impl Observer for Few {
        fn iteration(&mut self, record: &IterationRecord) {
            self.0.push(record.iteration);
        }
        fn should_stop(&self) -> bool {
            self.0.len() >= 2
        }
    }
    let mut few = Few(Vec::new());
    let mut scene = scene(Kind::Street, Noise { ray_rad: 1e-3, rotation_deg: 1.0, outliers: 0.1 }, 2);
    let report = solve(&mut scene.problem, &Options::default(), &mut few).unwrap();
    assert_eq!(few.0, [1, 2]);
    assert_eq!(report.kept().lm.termination, Termination::Stopped);
    assert!(scene.problem.centers.iter().any(|c| c.length() > 0.1), "the best state so far is the answer");
}

#[test]
fn garbage_gives_finite_positions_or_an_error() {
    let mut random = Random(11);
    for _ in 0..200 {
        let mut problem = garbage(&mut random);
        match solve(&mut problem, &Options::default(), &mut ()) {
            Ok(_) => assert!(problem.centers.iter().chain(&problem.points).all(|p| p.is_finite())),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
}
