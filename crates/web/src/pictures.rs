//! Photographs for colours, decoded one at a time.

use std::collections::BTreeMap;

use epipole_mapper::stages::finish::ImageSource;
use image::RgbImage;

use crate::bytes::TabFile;

/// Files by image name.
#[derive(Default)]
pub(crate) struct Pictures(BTreeMap<String, TabFile>);

impl Pictures {
    pub(crate) fn add(&mut self, name: String, file: TabFile) {
        self.0.insert(name, file);
    }

    pub(crate) fn join(&mut self, mut others: Self) {
        self.0.append(&mut others.0);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl ImageSource for Pictures {
    fn load(&mut self, name: &str) -> Option<RgbImage> {
        let bytes = self.0.get(name)?.read().ok()?;
        image::load_from_memory(&bytes).ok().map(|image| image.into_rgb8())
    }
}
