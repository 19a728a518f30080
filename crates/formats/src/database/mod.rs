//! COLMAP databases of every schema from 2016 to 4.2 (source: `algorithms.md` §3.1, §3.2).
//!
//! One bad row is dropped with a warning; what leaves nothing to reconstruct is an error.

mod blob;
mod cameras;
mod images;
mod open;
mod pairs;
mod ranged;
mod schema;
mod verified;
mod write;

use std::path::Path;
use std::rc::Rc;

use epipole_scene::ViewGraph;

use crate::error::{FormatError, Loaded, Location, Problem, Warnings};
use open::Source;

pub(crate) use cameras::check as check_camera;
pub use ranged::RangedBytes;
pub use write::write_database;

/// COLMAP's base of pair ids, and the bound of image ids.
pub(crate) const MAX_NUM_IMAGES: u64 = 2_147_483_647;

/// What to read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Also the raw matches, before geometric verification; their number is always read.
    pub raw_matches: bool,
}

/// Reads cameras, images, keypoints and pairs. The file is never modified; a `-wal` sidecar is taken into account.
///
/// # Errors
/// A file that is not an SQLite database or is cut off, missing tables or columns, no images, no usable camera or
/// no keypoints at all. Single bad rows are dropped with a warning; see `Loaded::warnings`.
pub fn read_database(path: &Path, options: &ReadOptions) -> Result<Loaded<ViewGraph>, FormatError> {
    read(&Source::open(path)?, options)
}

/// As [`read_database`], for a database that is read by ranges, with the bytes of its `-wal` sidecar if there is one.
/// `name` stands in messages.
///
/// # Errors
/// As [`read_database`].
pub fn read_ranged_database(
    name: &Path,
    database: Rc<dyn RangedBytes>,
    wal: Option<Rc<dyn RangedBytes>>,
    options: &ReadOptions,
) -> Result<Loaded<ViewGraph>, FormatError> {
    read(&Source::open_ranged(name, database, wal)?, options)
}

fn read(source: &Source, options: &ReadOptions) -> Result<Loaded<ViewGraph>, FormatError> {
    let path = source.path.as_path();
    let mut warnings = Warnings::default();
    let cameras = cameras::read(source, &mut warnings)?;
    let mut images = images::read(source, &cameras, &mut warnings)?;
    if images.is_empty() {
        // Every image was dropped for a reason that has just been written down.
        if let Some(reason) = warnings.first() {
            return Err(reason.clone().into());
        }
        return Err(FormatError::invalid(
            Location::table(path, "images"),
            Problem::Nothing("images"),
            "import or extract images first (`colmap feature_extractor`)",
        ));
    }
    let keypoints = images::read_keypoints(source, &mut images, &mut warnings)?;
    let pairs = pairs::read(source, &images, &keypoints, options, &mut warnings)?;
    if images.len() > 1 && pairs.is_empty() {
        warnings.push(
            Location::table(path, "two_view_geometries"),
            Problem::Nothing("pairs of images"),
            "nothing can be reconstructed; match the images and verify the matches (`colmap exhaustive_matcher`)",
        );
    }
    warn_about_rigs(source, &mut warnings)?;
    Ok(Loaded { value: ViewGraph { cameras, images, pairs }, warnings: warnings.finish() })
}

/// Sensors fixed to one another are read as free: say so.
fn warn_about_rigs(source: &Source, warnings: &mut Warnings) -> Result<(), FormatError> {
    let Some(table) = schema::Table::probe(source, &["rig_sensors"])? else { return Ok(()) };
    let mut sensors = 0u64;
    table.for_each(source, &["rig_id"], &[], |_| {
        sensors += 1;
        Ok(())
    })?;
    if sensors > 0 {
        warnings.push(
            source.table("rig_sensors"),
            Problem::Inconsistent(format!("{sensors} sensors are fixed to a rig")),
            "their relative poses are not used: every image is posed on its own",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests;
