//! The database of a scene, which stays where it is: read when it is opened, and again by a run that wants the raw matches too.

use std::path::Path;
use std::rc::Rc;

use epipole_formats::{RangedBytes, ReadOptions, read_ranged_database};
use epipole_scene::ViewGraph;

use crate::bytes::TabFile;
use crate::error::Failure;

/// A database and its `-wal`.
pub(crate) struct Source {
    pub(crate) path: String,
    pub(crate) database: Rc<TabFile>,
    pub(crate) wal: Option<Rc<TabFile>>,
}

impl Source {
    /// What is in it, and what was left out or mended.
    pub(crate) fn read(&self, raw_matches: bool) -> Result<(ViewGraph, Vec<String>), Failure> {
        let wal = self.wal.clone().map(|wal| wal as Rc<dyn RangedBytes>);
        let options = ReadOptions { raw_matches };
        let loaded = read_ranged_database(Path::new(&self.path), self.database.clone(), wal, &options)
            .map_err(|e| Failure::format(&self.path, &e))?;
        Ok((loaded.value, loaded.warnings.iter().map(ToString::to_string).collect()))
    }
}
