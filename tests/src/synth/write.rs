//! A scene as files: the COLMAP database the pipeline reads, and the truth as a COLMAP text model.

use std::path::Path;

use epipole_formats::{write_database, write_model_text};
use epipole_scene::Reconstruction;

use super::{Scene, SynthError};

/// Writes `folder/database.db` and `folder/truth/{cameras,images,points3D,…}.txt`.
///
/// # Errors
/// [`SynthError::Io`] where the folder cannot be made, [`SynthError::Format`] where a file cannot be written.
pub fn write_scene(scene: &Scene, folder: &Path) -> Result<(), SynthError> {
    make_folder(folder)?;
    write_database(&folder.join("database.db"), &scene.graph)?;
    write_truth(&scene.truth, &folder.join("truth"))
}

/// Writes a truth as a COLMAP text model.
///
/// # Errors
/// As [`write_scene`].
pub fn write_truth(truth: &Reconstruction, folder: &Path) -> Result<(), SynthError> {
    make_folder(folder)?;
    write_model_text(folder, truth)?;
    Ok(())
}

fn make_folder(folder: &Path) -> Result<(), SynthError> {
    std::fs::create_dir_all(folder).map_err(|source| SynthError::Io { path: folder.to_owned(), source })
}
