//! Graphs with known rotations.

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};

use super::super::{Edge, Options, average, robust::rotation_vector};

fn random_rotation(rng: &mut rand_pcg::Pcg64Mcg) -> DQuat {
    let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
    DQuat::from_xyzw(normal(), normal(), normal(), normal()).normalize()
}

/// `n` rotations and a random graph of about `degree` edges an image, a share of them replaced by random rotations.
fn graph(n: usize, degree: usize, noise_deg: f64, outliers: f64, seed: u64) -> (Vec<DQuat>, Vec<Edge>) {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let truth: Vec<DQuat> = (0..n).map(|_| random_rotation(&mut rng)).collect();
    let mut edges = Vec::new();
    for i in 0..n {
        for j in i + 1..n {
            if rng.random::<f64>() * n as f64 > degree as f64 {
                continue;
            }
            let mut normal = || ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0) * noise_deg.to_radians();
            let noise = DQuat::from_scaled_axis(DVec3::new(normal(), normal(), normal()));
            let mut j_from_i = noise * truth[j] * truth[i].conjugate();
            if rng.random::<f64>() < outliers {
                j_from_i = random_rotation(&mut rng);
            }
            edges.push(Edge { i, j, j_from_i: j_from_i.normalize(), weight: 1.0 + rng.random::<f64>() });
        }
    }
    (truth, edges)
}

/// Angles after the world of the estimate is turned by the one turn that a reference image asks for, degrees.
fn errors_deg(truth: &[DQuat], estimate: &[Option<DQuat>]) -> Vec<f64> {
    let world: Vec<DQuat> = truth.iter().zip(estimate).filter_map(|(t, e)| Some((*e)?.conjugate() * *t)).collect();
    let errors = |reference: &DQuat| -> Vec<f64> {
        world.iter().map(|w| rotation_vector(*w * reference.conjugate()).length().to_degrees()).collect()
    };
    let sum = |e: &Vec<f64>| e.iter().sum::<f64>();
    world.iter().map(errors).min_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap()
}

#[test]
fn exact_edges_give_exact_rotations() {
    let (truth, edges) = graph(50, 12, 0.0, 0.0, 1);
    let found = average(50, &edges, &Options::default()).unwrap();
    assert!(errors_deg(&truth, &found).iter().all(|&e| e < 1e-5));
}

#[test]
fn a_fifth_of_wrong_edges_costs_less_than_a_degree() {
    for seed in 0..4 {
        let (truth, edges) = graph(120, 24, 1.0, 0.2, seed);
        let found = average(120, &edges, &Options::default()).unwrap();
        let errors = errors_deg(&truth, &found);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        assert!(errors.len() == 120 && mean < 1.0, "seed {seed}: {mean}");
    }
}

#[test]
fn the_world_frame_of_the_edges_does_not_matter() {
    // Turning every camera in its own frame changes the edges and turns the answer with them.
    let (_, edges) = graph(40, 10, 1.0, 0.1, 9);
    let turn = |k: usize| DQuat::from_scaled_axis(DVec3::new(0.3 * k as f64, 1.0, -0.1 * k as f64));
    let turned: Vec<Edge> = edges
        .iter()
        .map(|e| Edge { j_from_i: (turn(e.j) * e.j_from_i * turn(e.i).conjugate()).normalize(), ..*e })
        .collect();
    let options = Options::default();
    let (a, b) = (average(40, &edges, &options).unwrap(), average(40, &turned, &options).unwrap());
    let relative = |k: usize| a[k].unwrap().conjugate() * turn(k).conjugate() * b[k].unwrap();
    for k in 1..40 {
        assert!(rotation_vector(relative(k) * relative(0).conjugate()).length() < 1e-3);
    }
}

#[test]
fn two_parts_are_averaged_apart_and_lone_images_left_alone() {
    let (truth, edges) = graph(30, 10, 0.0, 0.0, 3);
    let (more_truth, more) = graph(20, 8, 0.0, 0.0, 4);
    let shifted = more.iter().map(|e| Edge { i: e.i + 30, j: e.j + 30, ..*e });
    let all: Vec<Edge> = edges.iter().copied().chain(shifted).collect();
    let found = average(51, &all, &Options::default()).unwrap();
    assert!(errors_deg(&truth, &found[..30]).iter().all(|&e| e < 1e-5));
    assert!(errors_deg(&more_truth, &found[30..50]).iter().all(|&e| e < 1e-5));
    assert!(found[50].is_none());
}

#[test]
fn a_tighter_loss_does_not_open_a_loop() {
    // A ring whose relative rotations are all a little too large: the error is spread, not pushed into one gap.
    let n = 120;
    let turn = |degrees: f64| DQuat::from_rotation_y(degrees.to_radians());
    let mut edges = Vec::new();
    for i in 0..n {
        for step in 1..=3 {
            let j = (i + step) % n;
            edges.push(Edge { i, j, j_from_i: turn(3.1 * step as f64), weight: 1.0 });
        }
    }
    let found = average(n, &edges, &Options::default()).unwrap();
    let truth: Vec<DQuat> = (0..n).map(|i| turn(3.0 * i as f64)).collect();
    let errors = errors_deg(&truth, &found);
    assert!(errors.iter().all(|&e| e < 1.5), "{:?}", errors.iter().copied().fold(0.0, f64::max));
}

#[test]
fn bad_edges_are_refused() {
    let edge = |i, j, j_from_i| Edge { i, j, j_from_i, weight: 1.0 };
    for bad in [
        edge(0, 5, DQuat::IDENTITY),
        edge(1, 1, DQuat::IDENTITY),
        edge(0, 1, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)),
        edge(0, 1, DQuat::NAN),
    ] {
        assert!(average(3, &[bad], &Options::default()).is_err());
    }
    assert_eq!(average(3, &[], &Options::default()).unwrap(), [None; 3]);
}
