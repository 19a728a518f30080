//! What every end-to-end test does: run the pipeline, compare with the truth, check the written model.
#![allow(dead_code)] // Each test file uses its own part.

use std::path::Path;

use epipole_formats::{read_model, write_model_binary, write_model_text};
use epipole_mapper::{Event, Observer, Options, Outcome, reconstruct_blocking};
use epipole_optimize::Engine;
use epipole_scene::evaluate::{EvaluateOptions, Evaluation, evaluate};
use epipole_scene::{Reconstruction, ViewGraph};

/// Keeps the warnings.
#[derive(Default)]
pub(crate) struct Listener {
    /// What a person would be told.
    pub(crate) warnings: Vec<String>,
}

impl Observer for Listener {
    fn event(&mut self, event: &Event) {
        if let Event::Warning { message } = event {
            self.warnings.push(message.clone());
        }
    }
}

/// Runs the pipeline and checks every model it makes.
pub(crate) fn run(graph: &ViewGraph, options: &Options) -> Outcome {
    let outcome = reconstruct_blocking(graph.clone(), options, &mut Engine::Cpu, None, &mut Listener::default())
        .expect("a reconstruction");
    outcome.reconstructions.iter().for_each(check_consistent);
    outcome
}

/// Poses against a truth, by file name.
pub(crate) fn compare(estimate: &Reconstruction, truth: &Reconstruction) -> Evaluation {
    evaluate(estimate, truth, &EvaluateOptions::default())
}

/// What must hold of every model: tracks refer to keypoints that exist, no keypoint serves two points, errors are true,
/// numbers are finite.
pub(crate) fn check_consistent(model: &Reconstruction) {
    assert!(!model.images.is_empty() && !model.points.is_empty());
    let mut used: Vec<Vec<bool>> = model.images.iter().map(|i| vec![false; i.keypoints_px.len()]).collect();
    let mut ids = std::collections::BTreeSet::new();
    for point in &model.points {
        assert!(ids.insert(point.id), "point id {} occurs twice", point.id);
        assert!(point.position.is_finite());
        assert!(point.observations.len() >= 2, "a point seen once has no depth");
        let mut sum = 0.0;
        for &o in &point.observations {
            let slot = &mut used[o.image as usize][o.keypoint as usize];
            assert!(!*slot, "keypoint {} of image {} serves two points", o.keypoint, o.image);
            *slot = true;
            sum += model.reprojection_error_px(point, o);
        }
        let mean = sum / point.observations.len() as f64;
        assert!((mean - point.error_px).abs() < 1e-6, "stored error {} px, true error {mean} px", point.error_px);
    }
    for image in &model.images {
        assert!(image.cam_from_world.is_finite());
        assert!((image.cam_from_world.rotation.length() - 1.0).abs() < 1e-9);
        assert!(model.cameras[image.camera].validate().is_ok());
    }
}

/// The bytes of all files of a model folder, by name.
pub(crate) fn bytes_of(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| {
            let path = entry.expect("an entry").path();
            (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), std::fs::read(&path).expect("a file"))
        })
        .collect();
    files.sort();
    files
}

/// The model's binary files.
pub(crate) fn binary_of(model: &Reconstruction) -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model");
    write_model_binary(&path, model).expect("writing");
    bytes_of(&path)
}

/// Binary to text and back gives the same bytes.
pub(crate) fn check_round_trip(model: &Reconstruction) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [bin, text, again] = ["bin", "text", "again"].map(|name| folder.path().join(name));
    write_model_binary(&bin, model).expect("writing");
    let read = read_model(&bin).expect("reading what was written");
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    write_model_text(&text, &read.value).expect("writing text");
    let read = read_model(&text).expect("reading text");
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    write_model_binary(&again, &read.value).expect("writing");
    assert!(bytes_of(&bin) == bytes_of(&again), "bin → text → bin changed the bytes");
}
