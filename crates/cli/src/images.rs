//! The folder of images, for colours.

use std::path::{Path, PathBuf};

use epipole_mapper::stages::finish::{ImageSource, Loading};
use image::{ImageReader, RgbImage};

use crate::error::CliError;

/// Decodes images of a folder as they are asked for.
pub(crate) struct ImageFolder(PathBuf);

impl ImageFolder {
    /// A folder that exists; a mistyped name should be heard of before the work, not after.
    pub(crate) fn open(path: &Path) -> Result<Self, CliError> {
        if path.is_dir() {
            return Ok(Self(path.to_owned()));
        }
        Err(CliError::Usage(format!("--images {} is not a folder; give the folder of the images", path.display())))
    }
}

impl ImageFolder {
    fn read(&self, name: &str) -> Option<RgbImage> {
        // The kind is told from the content: endings lie.
        let reader = ImageReader::open(self.0.join(name)).ok()?.with_guessed_format().ok()?;
        Some(reader.decode().ok()?.into_rgb8())
    }
}

impl ImageSource for ImageFolder {
    fn load<'a>(&'a mut self, name: &'a str) -> Loading<'a> {
        Box::pin(std::future::ready(self.read(name)))
    }
}
