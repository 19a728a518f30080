//! The small scenes kept in the repository, and how they are made.
//!
//! They let the README's first command, the format tests and the bad-input tests run where no real data is.

use std::path::{Path, PathBuf};

use epipole_geometry::camera::CameraModel;

use crate::synth::{
    BalPerturbation, FocalKnowledge, Kind, Options, Scene, StoredPoses, SynthError, generate, write_bal, write_scene,
};

/// The folder of the fixtures.
pub fn folder() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures"))
}

/// `orbit/`: six cameras of two models with known focal lengths, three images each, so that a test can lose a camera
/// and still have a ring without gaps.
pub fn orbit() -> Options {
    Options {
        kind: Kind::Orbit,
        num_images: 18,
        num_points: 560,
        seed: 1,
        num_cameras: 6,
        models: vec![CameraModel::SimpleRadial, CameraModel::OpenCv],
        detection_rate: 0.7,
        focal: FocalKnowledge::Exact,
        poses: StoredPoses::Estimated,
        ..Options::default()
    }
}

/// `bal/problem-8-pre.txt`: a short drive, perturbed.
pub fn bal() -> Options {
    Options {
        kind: Kind::Street,
        num_images: 8,
        num_points: 300,
        seed: 2,
        num_cameras: 0,
        models: vec![CameraModel::Radial],
        ..Options::default()
    }
}

/// Makes the fixtures' scenes: the database's and the BAL file's.
///
/// # Errors
/// None in practice: the options are valid.
pub fn scenes() -> Result<[Scene; 2], SynthError> {
    Ok([generate(&orbit())?, generate(&bal())?])
}

/// Writes all fixtures.
///
/// # Errors
/// Whatever the file system refuses.
pub fn write_all(folder: &Path) -> Result<(), SynthError> {
    let [orbit, street] = scenes()?;
    write_scene(&orbit, &folder.join("orbit"))?;
    let bal = folder.join("bal");
    std::fs::create_dir_all(&bal).map_err(|source| SynthError::Io { path: bal.clone(), source })?;
    write_bal(&street, &BalPerturbation::default(), &bal.join("problem-8-pre.txt"))
}
