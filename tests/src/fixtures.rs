//! The small scenes kept in the repository, and how they are made.
//!
//! They let the README's first command, the format tests and the bad-input tests run where no real data is.

use std::path::{Path, PathBuf};

use epipole_geometry::camera::CameraModel;

use crate::synth::{
    BalPerturbation, DepthModel, FocalKnowledge, Kind, MapFiles, MapFormat, Options, Scene, StoredPoses, SynthError,
    generate, give_depths, write_bal, write_depth_maps, write_scene,
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
        depth: true,
        ..Options::default()
    }
}

/// `orbit/depth/`: what a sensor gives on a good day: 2 % noise, some errors, gaps, and two images without a map.
pub fn orbit_depths() -> DepthModel {
    DepthModel {
        share: 0.8,
        relative_noise: 0.02,
        gross_share: 0.03,
        missing_map_share: 0.1,
        seed: 3,
        ..DepthModel::default()
    }
}

/// Coarser than the images, as sensors' maps are, and small in the repository.
pub const ORBIT_MAPS: MapFiles = MapFiles { format: MapFormat::Png, shrink: 4 };

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

/// Makes the fixtures' scenes: the database's with its depths, and the BAL file's.
///
/// # Errors
/// None in practice: the options are valid.
pub fn scenes() -> Result<[Scene; 2], SynthError> {
    let mut with_depth = generate(&orbit())?;
    give_depths(&mut with_depth, &orbit_depths())?;
    Ok([with_depth, generate(&bal())?])
}

/// Writes all fixtures.
///
/// # Errors
/// Whatever the file system refuses.
pub fn write_all(folder: &Path) -> Result<(), SynthError> {
    let [orbit, street] = scenes()?;
    write_scene(&orbit, &folder.join("orbit"))?;
    write_depth_maps(&orbit, &folder.join("orbit/depth"), &ORBIT_MAPS)?;
    let bal = folder.join("bal");
    std::fs::create_dir_all(&bal).map_err(|source| SynthError::Io { path: bal.clone(), source })?;
    write_bal(&street, &BalPerturbation::default(), &bal.join("problem-8-pre.txt"))
}

/// Why the large database could not be made.
#[derive(Debug, thiserror::Error)]
pub enum LargeError {
    /// The statements did not run.
    #[error("{0}: {1}; is there room on the disk?")]
    Sql(PathBuf, rusqlite::Error),
    /// The file could not be made.
    #[error("{0}: {1}; choose a folder that can be written")]
    Io(PathBuf, std::io::Error),
}

/// What a database is large of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bulk {
    /// Descriptors of keypoints, which make real databases large and which nobody reads.
    Descriptors,
    /// Verified matches, which a solve has to hold: the same one again and again.
    Matches,
}

/// Writes the fixture's database with so much of something that the file has at least `bytes`.
///
/// # Errors
/// Whatever the file system or SQLite refuses.
pub fn write_large(path: &Path, bulk: Bulk, bytes: u64) -> Result<(), LargeError> {
    std::fs::copy(folder().join("orbit/database.db"), path).map_err(|e| LargeError::Io(path.to_owned(), e))?;
    let write = || -> rusqlite::Result<()> {
        let connection = rusqlite::Connection::open(path)?;
        connection.execute_batch("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; DELETE FROM descriptors")?;
        let (row_bytes, table, fill) = match bulk {
            Bulk::Descriptors => {
                (128, "images", "INSERT INTO descriptors SELECT image_id, 0, ?1, 128, zeroblob(128 * ?1) FROM images")
            }
            Bulk::Matches => {
                (8, "two_view_geometries", "UPDATE two_view_geometries SET rows = ?1, data = zeroblob(8 * ?1)")
            }
        };
        let count: i64 = connection.query_row(&format!("SELECT count(*) FROM {table}"), [], |row| row.get(0))?;
        connection.execute(fill, [bytes as i64 / row_bytes / count.max(1) + 1])?;
        Ok(())
    };
    write().map_err(|e| LargeError::Sql(path.to_owned(), e))
}

/// Copies `orbit/depth` to another folder, which is emptied before.
///
/// # Errors
/// Whatever the file system refuses.
pub fn copy_depth_maps(target: &Path) -> std::io::Result<()> {
    if target.is_dir() {
        std::fs::remove_dir_all(target)?;
    } else if target.exists() {
        std::fs::remove_file(target)?;
    }
    std::fs::create_dir_all(target)?;
    for entry in std::fs::read_dir(folder().join("orbit/depth"))? {
        let entry = entry?;
        std::fs::copy(entry.path(), target.join(entry.file_name()))?;
    }
    Ok(())
}
