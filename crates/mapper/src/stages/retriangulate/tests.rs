//! Tests of the passes and of the whole stage on scenes with known truth.

use std::collections::BTreeSet;

use epipole_optimize::executor::block_on;
use epipole_scene::Observation;
use glam::{DVec2, DVec3};

use super::scene_for_tests::{Recipe, Scene, pair};
use super::*;
use crate::event::Silent;

/// Every keypoint observes at most one point, and every point is seen from two images.
fn assert_consistent(component: &Component) {
    let mut seen = BTreeSet::new();
    for (i, point) in component.reconstruction.points.iter().enumerate() {
        assert_eq!(point.id, i as u64 + 1);
        let images: BTreeSet<u32> = point.observations.iter().map(|o| o.image).collect();
        assert!(images.len() >= 2, "{point:?}");
        for o in &point.observations {
            assert!(seen.insert(*o), "{o:?} observes two points");
        }
    }
}

fn create_all(correspondences: &CorrespondenceGraph, component: &mut Component, options: &Options, seed: u64) -> usize {
    block_on(super::create_all(correspondences, component, options, seed, &mut Silent))
}

fn complete_and_merge(correspondences: &CorrespondenceGraph, component: &mut Component, options: &Options) -> Grown {
    block_on(super::complete_and_merge(correspondences, component, options, &mut Silent))
}

fn retry_weak_pairs(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    options: &Options,
    seed: u64,
) -> (usize, usize) {
    block_on(super::retry_weak_pairs(correspondences, component, options, seed, &mut Silent))
}

fn create_and_grow(scene: &mut Scene, options: &Options) {
    let correspondences = scene.correspondences();
    create_all(&correspondences, &mut scene.component, options, 0);
    complete_and_merge(&correspondences, &mut scene.component, options);
}

#[test]
fn exact_matches_give_every_point_its_whole_track() {
    let mut scene = Recipe::default().build();
    create_and_grow(&mut scene, &Options::default());
    assert_consistent(&scene.component);
    assert_eq!(scene.component.reconstruction.points.len(), scene.points.len());
    for point in &scene.component.reconstruction.points {
        assert_eq!(point.observations.len(), 8, "every image sees every point");
        let first = point.observations[0];
        let truth = scene.points[scene.truth[first.image as usize][first.keypoint as usize]];
        assert!((point.position - truth).length() < 1e-6);
    }
}

#[test]
fn wrong_matches_do_not_enter_the_tracks() {
    let recipe = Recipe { wrong_matches: 0.15, noise_px: 0.5, images: 10, ..Recipe::default() };
    let mut scene = recipe.build();
    let correspondences = scene.correspondences();
    // The true poses need no adjustment. Rounds matter all the same: a filter frees the keypoints of chance
    // intersections, and the next round gives them to the points they belong to.
    let mut adjust = async |_: &mut Component, _: &mut dyn Observer| Ok(());
    block_on(run(&correspondences, &mut scene.component, &Options::default(), 0, &mut adjust, &mut Silent)).unwrap();
    assert_consistent_after_filter(&scene.component);
    let (mut right, mut wrong) = (0, 0);
    let mut recovered = BTreeSet::new();
    for point in &scene.component.reconstruction.points {
        let shown = |o: &Observation| scene.truth[o.image as usize][o.keypoint as usize];
        // The point's true identity is that of most of its observations.
        let of_each: Vec<usize> = point.observations.iter().map(shown).collect();
        let most = *of_each.iter().max_by_key(|p| of_each.iter().filter(|q| q == p).count()).unwrap();
        right += of_each.iter().filter(|&&p| p == most).count();
        wrong += of_each.iter().filter(|&&p| p != most).count();
        recovered.insert(most);
    }
    // Two points that a wrong match ties together become one where they are nearly the same in every image.
    for lost in (0..120).filter(|p| !recovered.contains(p)) {
        let px = |image: usize, point: usize| {
            scene.graph.images[image].keypoints_px[scene.keypoint(image, point).keypoint as usize]
        };
        let close = |other: usize| (0..10).all(|i| px(i, lost).distance(px(i, other)) < 2.0 * 15.0);
        assert!((0..120).any(|other| other != lost && close(other)), "point {lost} is lost");
    }
    assert!(recovered.len() >= 118, "{}", recovered.len());
    assert!(right > 1170, "{right} of 1200 observations");
    // A wrong keypoint within 4 px of the right place cannot be told from it.
    assert!(wrong < 12, "{wrong} wrong observations");
}

fn assert_consistent_after_filter(component: &Component) {
    let mut renumbered = component.clone();
    for (i, point) in renumbered.reconstruction.points.iter_mut().enumerate() {
        point.id = i as u64 + 1;
    }
    assert_consistent(&renumbered);
}

#[cfg(feature = "rayon")]
#[test]
fn the_number_of_threads_changes_nothing() {
    let run_on = |threads: usize| {
        let recipe = Recipe { wrong_matches: 0.3, noise_px: 1.0, images: 24, overlap: 20, ..Recipe::default() };
        let mut scene = recipe.build();
        let correspondences = scene.correspondences();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut adjust = async |_: &mut Component, _: &mut dyn Observer| Ok(());
            let component = &mut scene.component;
            block_on(run(&correspondences, component, &Options::default(), 5, &mut adjust, &mut Silent)).unwrap();
        });
        let points = &scene.component.reconstruction.points;
        points.iter().map(|p| (p.position.to_array().map(f64::to_bits), p.observations.clone())).collect::<Vec<_>>()
    };
    let one = run_on(1);
    assert!(one.len() > 100);
    assert!(one == run_on(2) && one == run_on(3));
}

#[test]
fn completing_follows_matches_up_to_the_bound_and_no_farther() {
    // A chain: image i is matched with i + 1 only.
    let mut scene = Recipe { points: 1, overlap: 1, ..Recipe::default() }.build();
    let correspondences = scene.correspondences();
    let start = scene.point(0, &[0, 1]);
    for (transitivity, length) in [(0, 2), (1, 3), (3, 5), (5, 7), (9, 8)] {
        scene.component.reconstruction.points = vec![start.clone()];
        let options = Options { complete_max_transitivity: transitivity, ..Options::default() };
        let grown = complete_and_merge(&correspondences, &mut scene.component, &options);
        assert_eq!(grown, Grown { completed: length - 2, merged: 0 });
        assert_eq!(scene.component.reconstruction.points[0].observations.len(), length);
    }
}

#[test]
fn completing_leaves_out_what_projects_too_far_away() {
    let mut scene = Recipe { points: 1, ..Recipe::default() }.build();
    for (offset_px, taken) in [(14.0, true), (16.0, false)] {
        let mut keypoints = scene.graph.images[4].keypoints_px.to_vec();
        let exact = keypoints[0];
        keypoints[0] += DVec2::new(offset_px, 0.0);
        scene.component.reconstruction.images[4].keypoints_px = keypoints.into();
        scene.component.reconstruction.points = vec![scene.point(0, &[0, 1, 2, 3, 5, 6, 7])];
        let options = Options { polish_steps: 0, ..Options::default() };
        complete_and_merge(&scene.correspondences(), &mut scene.component, &options);
        let observations = &scene.component.reconstruction.points[0].observations;
        assert_eq!(observations.iter().any(|o| o.image == 4), taken, "{offset_px} px");
        assert_eq!(scene.graph.images[4].keypoints_px[0], exact);
    }
}

#[test]
fn halves_of_a_track_are_merged_and_different_points_are_not() {
    let mut scene = Recipe { points: 2, ..Recipe::default() }.build();
    scene.points = vec![DVec3::ZERO, DVec3::new(0.4, 0.0, 0.0)];
    // A wrong match ties the two points together.
    let (a, b) = (scene.keypoint(3, 0), scene.keypoint(4, 1));
    let tied = scene.graph.pairs.iter().position(|p| (p.image1, p.image2) == (3, 4)).unwrap();
    scene.graph.pairs[tied].inliers.push([a.keypoint, b.keypoint]);
    let true_positions = Recipe { points: 2, ..Recipe::default() }.build().points;
    scene.points = true_positions;
    let mut lower = scene.point(0, &[0, 1, 2]);
    lower.position += DVec3::new(0.002, 0.0, 0.0);
    let upper = scene.point(0, &[3, 4, 5, 6, 7]);
    let other = scene.point(1, &[0, 1, 2, 3, 4, 5, 6, 7]);
    scene.component.reconstruction.points = vec![other, upper, lower];
    let options = Options { polish_steps: 0, ..Options::default() };
    let grown = complete_and_merge(&scene.correspondences(), &mut scene.component, &options);
    assert_eq!(grown, Grown { completed: 0, merged: 8 });
    let points = &scene.component.reconstruction.points;
    assert_eq!(points.iter().map(|p| p.observations.len()).collect::<Vec<_>>(), [8, 8]);
    let mean = scene.points[0] + DVec3::new(0.002 * 3.0 / 8.0, 0.0, 0.0);
    assert!((points[1].position - mean).length() < 1e-12, "weighted by track length");
    assert_consistent(&scene.component);
}

#[test]
fn isolated_matches_are_left_out_unless_asked_for() {
    let mut scene = Recipe { points: 30, images: 4, overlap: 1, ..Recipe::default() }.build();
    // Even points are seen by images 0 and 1 only, odd ones by 0, 1 and 2.
    scene.retain_matches(|i, _, point| i == 0 || (i == 1 && point % 2 == 1));
    create_and_grow(&mut scene, &Options::default());
    assert_eq!(scene.component.reconstruction.points.len(), 15);
    assert!(scene.component.reconstruction.points.iter().all(|p| p.observations.len() == 3));
    create_and_grow(&mut scene, &Options { ignore_two_view_tracks: false, ..Options::default() });
    assert_eq!(scene.component.reconstruction.points.len(), 30);
    assert_consistent(&scene.component);
}

#[test]
fn a_chain_of_three_may_leave_a_track_of_two() {
    let mut scene = Recipe { points: 1, images: 3, overlap: 1, ..Recipe::default() }.build();
    let mut keypoints = scene.graph.images[2].keypoints_px.to_vec();
    keypoints[0] += DVec2::new(0.0, 200.0);
    scene.component.reconstruction.images[2].keypoints_px = keypoints.into();
    create_and_grow(&mut scene, &Options::default());
    let points = &scene.component.reconstruction.points;
    assert_eq!(points.len(), 1);
    assert_eq!(points[0].observations.iter().map(|o| o.image).collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn narrow_rays_found_no_point() {
    let mut scene = Recipe { points: 10, images: 3, ..Recipe::default() }.build();
    create_and_grow(&mut scene, &Options { min_angle_deg: 13.0, ..Options::default() });
    let narrow = scene.component.reconstruction.points.len();
    create_and_grow(&mut scene, &Options::default());
    // Twelve degrees between the outer cameras at the middle; only points nearer to them are seen under thirteen.
    assert_eq!(scene.component.reconstruction.points.len(), 10);
    assert!(narrow < 10, "{narrow}");
}

#[test]
fn images_of_a_bogus_camera_take_no_part() {
    let mut scene = Recipe::default().build();
    let mut bogus = scene.component.reconstruction.cameras[0].clone();
    bogus.params[0] = 1.0;
    scene.component.reconstruction.cameras.push(bogus);
    scene.component.reconstruction.images[2].camera = 1;
    create_and_grow(&mut scene, &Options::default());
    let points = &scene.component.reconstruction.points;
    assert_eq!(points.len(), scene.points.len());
    assert!(points.iter().all(|p| p.observations.len() == 7 && p.observations.iter().all(|o| o.image != 2)));
}

#[test]
fn keypoints_and_poses_that_are_not_numbers_are_passed_over() {
    let mut scene = Recipe::default().build();
    let keypoints = vec![DVec2::NAN; scene.points.len()];
    scene.component.reconstruction.images[2].keypoints_px = keypoints.into();
    scene.component.reconstruction.images[5].cam_from_world.translation.x = f64::INFINITY;
    create_and_grow(&mut scene, &Options::default());
    let points = &scene.component.reconstruction.points;
    assert_eq!(points.len(), scene.points.len());
    assert!(points.iter().all(|p| p.observations.len() == 6 && p.position.is_finite()));
}

#[test]
fn points_that_span_clusters_are_kept_as_they_are() {
    let mut scene = Recipe { points: 3, ..Recipe::default() }.build();
    let mut foreign = scene.point(0, &[0, 1]);
    foreign.observations.push(scene.keypoint(2, 1));
    scene.component.reconstruction.points = vec![scene.point(2, &[0, 1]), foreign.clone()];
    complete_and_merge(&scene.correspondences(), &mut scene.component, &Options::default());
    let points = &scene.component.reconstruction.points;
    assert_eq!(points.len(), 2);
    assert_eq!((points[0].observations.clone(), points[0].position), (foreign.observations, foreign.position));
    assert_eq!(points[1].observations.len(), 8);
    assert_consistent(&scene.component);
}

#[test]
fn the_filter_drops_far_observations_and_points_that_fall_below_two() {
    let mut scene = Recipe { points: 4, ..Recipe::default() }.build();
    let mut moved = |image: usize, point: usize, px: f64| {
        let o = scene.keypoint(image, point);
        let mut keypoints = scene.component.reconstruction.images[image].keypoints_px.to_vec();
        keypoints[o.keypoint as usize].x += px;
        scene.component.reconstruction.images[image].keypoints_px = keypoints.into();
    };
    moved(1, 0, 3.9);
    moved(2, 0, 4.1);
    moved(0, 1, 9.0);
    scene.component.reconstruction.points = vec![
        scene.point(0, &[0, 1, 2]),
        scene.point(1, &[0, 1]),
        scene.point(2, &[0, 1, 2]),
        // Behind all cameras.
        scene.point(3, &[0, 1, 2]),
    ];
    scene.component.reconstruction.points[3].position = DVec3::new(0.0, 0.0, -50.0);
    assert_eq!(filter(&mut scene.component, 4.0, 1.5), 1 + 2 + 3);
    let kept = |c: &Component| c.reconstruction.points.iter().map(|p| p.observations.len()).collect::<Vec<_>>();
    assert_eq!(kept(&scene.component), [2, 3]);
    // Six degrees between neighbours, twelve between the outer two of three.
    assert_eq!(filter(&mut scene.component, 4.0, 9.0), 2);
    assert_eq!(kept(&scene.component), [3]);
    assert_eq!(filter(&mut scene.component, 4.0, 20.0), 3);
}

#[test]
fn polishing_finds_the_least_reprojection_error() {
    let mut scene = Recipe { points: 40, noise_px: 0.7, ..Recipe::default() }.build();
    let all: Vec<usize> = (0..8).collect();
    scene.component.reconstruction.points = (0..40).map(|p| scene.point(p, &all)).collect();
    for point in &mut scene.component.reconstruction.points {
        point.position += DVec3::new(0.02, -0.01, 0.015);
    }
    let options = Options { polish_huber_px: 10.0, ..Options::default() };
    complete_and_merge(&scene.correspondences(), &mut scene.component, &options);
    let r = &scene.component.reconstruction;
    let cost =
        |p: &epipole_scene::Point| p.observations.iter().map(|&o| r.reprojection_error_px(p, o).powi(2)).sum::<f64>();
    for point in &r.points {
        for step in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|d| [d, -d]) {
            let mut beside = point.clone();
            beside.position += 2e-3 * step;
            assert!(cost(&beside) > cost(point), "not a minimum");
        }
    }
}

#[test]
fn weak_pairs_are_those_without_common_points_and_get_a_wider_bound() {
    let mut scene = Recipe { points: 20, images: 4, ..Recipe::default() }.build();
    let correspondences = scene.correspondences();
    scene.component.reconstruction.points = (0..20).map(|p| scene.point(p, &[0, 1, 2])).collect();
    let pairs = WeakPairs::new(&correspondences, &scene.component, 0.2);
    assert_eq!(pairs.len(), 3, "those of image 3");
    let (tried, added) = retry_weak_pairs(&correspondences, &mut scene.component, &Options::default(), 0);
    assert_eq!((tried, added), (3, 20));
    assert!(scene.component.reconstruction.points.iter().all(|p| p.observations.len() == 4));
    assert_eq!(retry_weak_pairs(&correspondences, &mut scene.component, &Options::default(), 0), (0, 0));
}

#[test]
fn the_stage_alternates_until_little_changes() {
    let mut scene = Recipe { noise_px: 0.5, wrong_matches: 0.05, ..Recipe::default() }.build();
    let correspondences = scene.correspondences();
    let before = scene.point(0, &[0, 1]);
    scene.component.reconstruction.points = vec![before];
    let mut calls = 0;
    let mut adjust = async |component: &mut Component, _: &mut dyn Observer| {
        calls += 1;
        assert!(component.reconstruction.points.len() >= 100);
        Ok(())
    };
    let component = &mut scene.component;
    let summary = block_on(run(&correspondences, component, &Options::default(), 0, &mut adjust, &mut Silent)).unwrap();
    assert_eq!((summary.points_before, summary.observations_before), (1, 2));
    assert_eq!(summary.rounds, calls);
    assert!((1..5).contains(&calls), "{calls}");
    assert_eq!(summary.points_after, component.reconstruction.points.len());
    assert_eq!(summary.observations_after, component.reconstruction.num_observations());
    assert!(summary.filtered > 0 && summary.merged > 0);
    assert_consistent_after_filter(component);
}

struct Stopping;

impl Observer for Stopping {
    fn event(&mut self, event: &Event) {
        if let Event::Progress { done, total, .. } = event {
            assert!(done <= total);
        }
    }

    fn should_stop(&self) -> bool {
        true
    }
}

#[test]
fn asked_to_stop_it_keeps_what_it_has_and_errors_come_through() {
    let mut scene = Recipe::default().build();
    let correspondences = scene.correspondences();
    let mut never =
        async |_: &mut Component, _: &mut dyn Observer| -> Result<(), MapperError> { panic!("stopped before") };
    let component = &mut scene.component;
    let summary =
        block_on(run(&correspondences, component, &Options::default(), 0, &mut never, &mut Stopping)).unwrap();
    assert_eq!((summary.rounds, summary.points_after), (0, 120));
    let mut fails = async |_: &mut Component, _: &mut dyn Observer| Err(MapperError::Stopped);
    assert!(block_on(run(&correspondences, component, &Options::default(), 0, &mut fails, &mut Silent)).is_err());
}

#[test]
fn nothing_in_nothing_out() {
    let correspondences = CorrespondenceGraph::default();
    let mut component = Component::default();
    let mut adjust = async |_: &mut Component, _: &mut dyn Observer| Ok(());
    let summary =
        block_on(run(&correspondences, &mut component, &Options::default(), 0, &mut adjust, &mut Silent)).unwrap();
    assert_eq!((summary.points_after, summary.rounds), (0, 1));
    let mut scene = Recipe::default().build();
    scene.graph.pairs = vec![pair(0, 1, Vec::new())];
    create_and_grow(&mut scene, &Options::default());
    assert!(scene.component.reconstruction.points.is_empty());
}

#[test]
fn options_refuse_unknown_names_and_default_the_rest() {
    let options: Options = serde_json::from_str(r#"{"rounds": 2}"#).unwrap();
    assert_eq!(options, Options { rounds: 2, ..Options::default() });
    assert!(serde_json::from_str::<Options>(r#"{"round": 2}"#).is_err());
}
