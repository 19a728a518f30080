//! Depth maps out: the two formats that every program of the field reads.

use std::path::Path;

use epipole_scene::depth::DepthMap;
use png::{BitDepth, ColorType, Encoder};

use crate::atomic::atomic_write;
use crate::error::{FormatError, Location, Problem};

/// Writes a map as 16-bit grey PNG with `scale_m` metres a unit; unknown and unrepresentable values are written as 0. Atomic.
///
/// # Errors
/// A map larger than a PNG may be, or whatever the file system refuses.
pub fn write_depth_png(path: &Path, map: &DepthMap, scale_m: f64) -> Result<(), FormatError> {
    let too_large =
        || FormatError::invalid(Location::file(path), Problem::Inconsistent("too large".into()), "write npy");
    let side = |n: usize| u32::try_from(n).map_err(|_| too_large());
    let (width, height) = (side(map.width())?, side(map.height())?);
    let units = map.values_m().iter().map(|&value| {
        // 65 535 means that there is no depth; `as` makes 0 of NaN.
        let units = (f64::from(value) / scale_m).round();
        if units < f64::from(u16::MAX) { units as u16 } else { 0 }
    });
    let bytes: Vec<u8> = units.flat_map(u16::to_be_bytes).collect();
    atomic_write(path, |writer| {
        let mut encoder = Encoder::new(writer, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Sixteen);
        let write = || -> Result<(), png::EncodingError> {
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&bytes)?;
            writer.finish()
        };
        write().map_err(|e| FormatError::io(path, e.into()))
    })
}

/// Writes a map as npy, `f4`, metres; unknown values are NaN. Atomic.
///
/// # Errors
/// Whatever the file system refuses.
pub fn write_depth_npy(path: &Path, map: &DepthMap) -> Result<(), FormatError> {
    let shape = format!("({}, {})", map.height(), map.width());
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    // The data begin at a multiple of 64 bytes; the header ends with a line feed (numpy.lib.format).
    let filled = (10 + header.len() + 1).next_multiple_of(64) - 10 - 1;
    header.extend(std::iter::repeat_n(' ', filled - header.len()));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(map.values_m().iter().flat_map(|value| value.to_le_bytes()));
    atomic_write(path, |writer| writer.write_all(&bytes).map_err(|e| FormatError::io(path, e)))
}
