//! The same seed gives the same bytes, run after run and with any number of threads.

mod common;

use common::{binary_of, run};
use epipole_mapper::{Component, Event, Matches, Observer, Options, Stage, reconstruct_blocking};
use epipole_optimize::Engine;
use epipole_optimize::lm::Places;
use epipole_tests::synth::{self, Kind, generate};

fn scene() -> synth::Scene {
    let scene = generate(&synth::Options {
        kind: Kind::Street,
        seed: 31,
        num_images: 16,
        num_points: 1500,
        outlier_share: 0.05,
        ..synth::Options::default()
    });
    scene.expect("a scene")
}

fn model_bytes(threads: usize, options: &Options) -> Vec<Vec<(String, Vec<u8>)>> {
    let scene = scene();
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

/// Looks at everything that there is to see, and holds it to what comes of it.
#[derive(Default)]
struct Spectator {
    accepted_steps: usize,
    previews: usize,
    agreements: usize,
    adjusting: bool,
    last: Option<Places>,
}

impl Observer for Spectator {
    fn event(&mut self, event: &Event) {
        match event {
            Event::StageStarted { stage, .. } => self.adjusting = *stage != Stage::Position,
            Event::Iteration { accepted: true, .. } => self.accepted_steps += 1,
            _ => {}
        }
    }

    fn wants_preview(&self) -> bool {
        true
    }

    fn preview(&mut self, component: &Component, places: &Places) {
        self.previews += 1;
        assert_eq!(places.centers.len(), component.reconstruction.images.len());
        assert!(places.points.iter().all(|(_, position)| position.is_finite()));
        self.last = Some(places.clone());
    }

    fn snapshot(&mut self, component: &Component, _complete: bool) {
        let Some(places) = self.last.take().filter(|_| self.adjusting) else { return };
        for (image, center) in places.centers {
            let pose = component.reconstruction.images[image as usize].cam_from_world;
            assert!(pose.center().distance(center) < 1e-9);
        }
        for (point, position) in places.points {
            assert!(component.reconstruction.points[point as usize].position.distance(position) < 1e-9);
        }
        self.agreements += 1;
    }
}

/// Previews show what a solve has got to, its last one what becomes of it; and looking changes nothing.
#[test]
fn watched() {
    let mut spectator = Spectator::default();
    let options = Options::default();
    let outcome = reconstruct_blocking(scene().graph, &options, &mut Engine::Cpu, None, &mut spectator);
    let watched: Vec<_> = outcome.expect("a reconstruction").reconstructions.iter().map(binary_of).collect();
    assert!(watched == model_bytes(2, &options), "a watched run differs");
    assert!(spectator.agreements > 3, "{} solves were watched to their end", spectator.agreements);
    assert_eq!(spectator.previews, spectator.accepted_steps);
}
