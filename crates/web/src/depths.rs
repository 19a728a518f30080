//! Depth maps that the page has given: read when a run needs them, one at a time.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

use epipole_formats::depth::{DepthAttachment, DepthFiles, DepthNames, DepthSidecar, SIDECAR_NAME};
use epipole_mapper::{Observer, breath};
use epipole_scene::ViewGraph;
use epipole_scene::depth::{DepthInput, DepthOptions};

use crate::bytes::TabFile;
use crate::error::Failure;

/// Files by path.
#[derive(Default)]
pub(crate) struct DepthMaps(RefCell<BTreeMap<String, TabFile>>);

impl DepthMaps {
    pub(crate) fn add(&self, path: String, file: TabFile) {
        self.0.borrow_mut().insert(path, file);
    }

    /// Puts the depths of the keypoints into the graph; nothing where there are no maps.
    ///
    /// # Errors
    /// A bad sidecar. A map that is missing or broken is reported in the answer.
    pub(crate) async fn attach(
        &self,
        graph: &mut ViewGraph,
        options: &DepthOptions,
        observer: &mut dyn Observer,
    ) -> Result<Option<DepthInput>, Failure> {
        if self.0.borrow().is_empty() {
            return Ok(None);
        }
        let (paths, sidecar) = (self.paths(), self.sidecar()?);
        let names = DepthNames::of(paths.iter().map(String::as_str));
        let attachment = DepthAttachment::new(graph, &names, self, sidecar);
        let mut input = DepthInput::default();
        for image in 0..graph.images.len() {
            attachment.attach(graph, image, options, &mut input);
            breath(observer).await;
            if observer.should_stop() {
                break;
            }
        }
        Ok(Some(input))
    }

    fn paths(&self) -> Vec<String> {
        self.0.borrow().keys().filter(|path| !is_sidecar(path)).cloned().collect()
    }

    /// The first in the order of paths: the one highest up where several were dropped.
    fn sidecar(&self) -> Result<DepthSidecar, Failure> {
        let files = self.0.borrow();
        let Some((path, file)) = files.iter().filter(|(path, _)| is_sidecar(path)).min_by_key(|(path, _)| path.len())
        else {
            return Ok(DepthSidecar::default());
        };
        let bytes = file.read().map_err(|e| Failure::new(path, e, "drop it again"))?;
        DepthSidecar::from_text(&String::from_utf8_lossy(&bytes), Path::new(path))
            .map_err(|e| Failure::format(path, &e))
    }
}

impl DepthFiles for DepthMaps {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let files = self.0.borrow();
        let file = path.to_str().and_then(|path| files.get(path));
        file.ok_or_else(|| std::io::Error::from(std::io::ErrorKind::NotFound))?.read()
    }
}

fn is_sidecar(path: &str) -> bool {
    path.rsplit('/').next() == Some(SIDECAR_NAME)
}
