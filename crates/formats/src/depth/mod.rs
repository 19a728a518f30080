//! Depth maps of images: found in a folder by the images' names, read from whatever format they are in, sampled at the
//! keypoints, one map in memory at a time.

mod attach;
mod colmap;
#[cfg(not(target_family = "wasm"))]
mod exr;
mod folder;
mod npy;
mod npz;
mod png;
mod raster;
mod sidecar;
#[cfg(test)]
mod tests;
#[cfg(not(target_family = "wasm"))]
mod tiff;
mod write;

use std::path::Path;

use epipole_scene::depth::DepthMap;

pub use attach::{DepthAttachment, attach_depths};
pub use folder::{DepthFiles, DepthNames, OnDisk};
pub use sidecar::{DepthSidecar, SIDECAR_NAME};
pub use write::{write_depth_npy, write_depth_png};

use crate::error::{FormatError, Location, Problem};
use raster::Raster;

/// Reads a depth map: 16-bit grey PNG, npy or npz (f2, f4, f8, whole numbers; either order), TIFF of one channel, OpenEXR,
/// or COLMAP's dense format. The kind is told from the content.
///
/// `scale` is metres a unit; if not given, 0.001 for whole numbers and 1 for floating-point numbers. Of whole numbers, 0 and
/// the largest one that the type holds mean that there is no depth.
///
/// # Errors
/// A file that cannot be read, is of another kind, or is damaged.
pub fn read_depth_map(path: &Path, scale: Option<f64>) -> Result<DepthMap, FormatError> {
    read_depths(&OnDisk, path, scale)
}

fn read_depths(files: &dyn DepthFiles, path: &Path, scale: Option<f64>) -> Result<DepthMap, FormatError> {
    read(files, path)?.into_depths(scale).map_err(|problem| invalid(path, problem))
}

/// Reads the confidences that belong to a depth map: 8- or 16-bit grey PNG or any format of [`read_depth_map`].
fn read_confidence(
    files: &dyn DepthFiles,
    path: &Path,
    full: Option<f64>,
) -> Result<(usize, usize, Vec<f32>), FormatError> {
    let raster = read(files, path)?;
    Ok((raster.width, raster.height, raster.into_confidences(full)))
}

fn read(files: &dyn DepthFiles, path: &Path) -> Result<Raster, FormatError> {
    let bytes = files.read(path).map_err(|e| FormatError::io(path, e))?;
    parse(&bytes).map_err(|problem| invalid(path, problem))
}

fn invalid(path: &Path, problem: Problem) -> FormatError {
    FormatError::invalid(Location::file(path), problem, "its image is used without depth")
}

fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    match bytes {
        [] => Err(Problem::Empty),
        [0x89, b'P', b'N', b'G', ..] => png::parse(bytes),
        [0x93, b'N', b'U', b'M', ..] => npy::parse(bytes),
        [b'P', b'K', ..] => npz::parse(bytes),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => parse_tiff(bytes),
        [0x76, 0x2F, 0x31, 0x01, ..] => parse_exr(bytes),
        [b'0'..=b'9', ..] => colmap::parse(bytes),
        _ => Err(Problem::WrongKind {
            expected: "a depth map",
            reason: "its first bytes are not those of a PNG, npy, npz, TIFF, OpenEXR or dense COLMAP file".into(),
        }),
    }
}

#[cfg(not(target_family = "wasm"))]
use {exr::parse as parse_exr, tiff::parse as parse_tiff};

#[cfg(target_family = "wasm")]
fn parse_exr(_: &[u8]) -> Result<Raster, Problem> {
    not_here("OpenEXR")
}

#[cfg(target_family = "wasm")]
fn parse_tiff(_: &[u8]) -> Result<Raster, Problem> {
    not_here("TIFF")
}

#[cfg(target_family = "wasm")]
fn not_here(format: &str) -> Result<Raster, Problem> {
    Err(Problem::WrongKind {
        expected: "a depth map that a browser tab reads",
        reason: format!("{format} is read by the command line only; convert it to 16-bit PNG or npy"),
    })
}
