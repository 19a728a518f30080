//! The same seed gives the same bytes, run after run and with any number of threads.

mod common;

use common::{binary_of, run};
use epipole_mapper::{Matches, Options};
use epipole_tests::synth::{self, Kind, generate};

fn model_bytes(threads: usize, options: &Options) -> Vec<Vec<(String, Vec<u8>)>> {
    let scene = generate(&synth::Options {
        kind: Kind::Street,
        seed: 31,
        num_images: 16,
        num_points: 1500,
        outlier_share: 0.05,
        ..synth::Options::default()
    });
    let scene = scene.expect("a scene");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let outcome = pool.install(|| run(&scene.graph, options));
    outcome.reconstructions.iter().map(binary_of).collect()
}

fn assert_deterministic(options: &Options) {
    let first = model_bytes(2, options);
    assert!(!first.is_empty());
    assert!(first == model_bytes(2, options), "two runs differ");
    assert!(first == model_bytes(1, options), "one thread differs from two");
    assert!(first == model_bytes(5, options), "five threads differ from two");
}

#[test]
fn stored_poses() {
    assert_deterministic(&Options::default());
}

#[test]
fn estimated_poses() {
    assert_deterministic(&Options { matches: Matches::Raw, ..Options::default() });
}
