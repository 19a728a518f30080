//! Finding the model a person means.

use std::path::{Path, PathBuf};

use epipole_formats::{Loaded, find_model_format, read_model};
use epipole_scene::Reconstruction;

use crate::error::CliError;
use crate::output;

/// `path`, or its subfolder 0 if only that holds a model (the largest of a reconstruction's output).
pub(crate) fn model_folder(path: &Path) -> PathBuf {
    let first = path.join("0");
    if find_model_format(path).is_none() && find_model_format(&first).is_some() { first } else { path.to_owned() }
}

/// Reads a model and reports its warnings.
pub(crate) fn read(path: &Path, json: bool) -> Result<Reconstruction, CliError> {
    let Loaded { value, warnings } = read_model(&model_folder(path)).map_err(CliError::Input)?;
    output::warnings(&warnings, json);
    Ok(value)
}

/// Sets the number of threads of everything that follows.
pub(crate) fn use_threads(threads: Option<u16>) -> Result<(), CliError> {
    let Some(threads) = threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.into())
        .build_global()
        .map_err(|e| CliError::Usage(format!("{threads} threads could not be started: {e}")))
}
