//! Bad input ends in a typed error that names array and row, and leaves the problem alone.

use glam::DVec3;

use super::scene::{Kind, Noise, scene};
use crate::error::OptimizeError;
use crate::positioning::{Options, Problem, solve};

fn error(spoil: impl FnOnce(&mut Problem)) -> OptimizeError {
    let mut problem = scene(Kind::Orbit, Noise::default(), 1).problem;
    spoil(&mut problem);
    let centers = problem.centers.clone();
    let error = solve(&mut problem, &Options::default(), &mut ()).unwrap_err();
    assert_eq!(centers, problem.centers);
    error
}

fn value_row(error: &OptimizeError) -> Option<(&'static str, usize)> {
    match error {
        OptimizeError::Value { array, row, .. } | OptimizeError::Index { array, row, .. } => Some((array, *row)),
        _ => None,
    }
}

#[test]
fn bad_numbers_are_named() {
    for bad in [DVec3::new(f64::NAN, 0.0, 1.0), DVec3::ZERO, DVec3::new(0.0, 0.0, 2.0), DVec3::splat(f64::INFINITY)] {
        assert_eq!(value_row(&error(|p| p.observation_ray[7] = bad)), Some(("observation_ray", 7)));
    }
    for bad in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
        assert_eq!(value_row(&error(|p| p.image_weight[3] = bad)), Some(("image_weight", 3)));
    }
    assert_eq!(value_row(&error(|p| p.observation_image[5] = 50)), Some(("observation_image", 5)));
    let pin = |p: &mut Problem| {
        let mut pins = vec![0.0; p.observations()];
        pins[2] = f64::NAN;
        p.pinned_scale = Some(pins);
    };
    assert_eq!(value_row(&error(pin)), Some(("pinned_scale", 2)));
    assert_eq!(value_row(&error(|p| p.track_start[4] = 0)), Some(("track_start", 3)));
    assert_eq!(value_row(&error(|p| p.track_start[0] = 1)), Some(("track_start", 0)));
}

#[test]
fn arrays_that_do_not_fit_are_named() {
    let array = |error: OptimizeError| match error {
        OptimizeError::Length { array, .. } => array,
        other => panic!("{other}"),
    };
    assert_eq!(array(error(|p| p.image_weight.push(1.0))), "image_weight");
    assert_eq!(array(error(|p| p.track_start.push(0))), "track_start");
    assert_eq!(array(error(|p| p.observation_ray.truncate(9))), "observation_ray");
    assert_eq!(array(error(|p| p.pinned_scale = Some(vec![0.0]))), "pinned_scale");
    assert_eq!(array(error(|p| *p = Problem::default())), "track_start");
}

#[test]
fn nothing_to_solve_is_an_error() {
    let nothing = |error: OptimizeError| assert!(matches!(error, OptimizeError::NothingToPosition { .. }), "{error}");
    nothing(error(|p| *p = Problem { track_start: vec![0], ..Problem::default() }));
    // Every observation in one image.
    nothing(error(|p| p.observation_image.fill(4)));
}
