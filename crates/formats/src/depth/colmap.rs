//! COLMAP's dense depth maps, `.geometric.bin` and `.photometric.bin` (algorithms.md §3.5): `width&height&channels&` in
//! ASCII, then `f32` little-endian, row by row.

use super::raster::{Raster, check_size};
use crate::error::Problem;

/// Digits of the longest number in the header.
const MAX_DIGITS: usize = 10;

pub(super) fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    let mut rest = bytes;
    let mut number = || {
        let end = rest.iter().take(MAX_DIGITS + 1).position(|&b| b == b'&')?;
        let number: u64 = std::str::from_utf8(&rest[..end]).ok()?.parse().ok()?;
        rest = &rest[end + 1..];
        Some(number)
    };
    let header = (|| Some([number()?, number()?, number()?]))();
    let Some([width, height, channels]) = header else {
        return Err(Problem::WrongKind {
            expected: "a depth map of COLMAP",
            reason: "it does not begin with width&height&channels&".into(),
        });
    };
    if channels != 1 {
        return Err(Problem::WrongKind {
            expected: "a depth map of COLMAP",
            reason: format!("it has {channels} channels; a normal map has 3"),
        });
    }
    let pixels = check_size(width, height, 4, rest.len() as u64)?;
    if rest.len() / 4 < pixels {
        return Err(Problem::Truncated { expected: 4 * pixels as u64, found: rest.len() as u64 });
    }
    let values = rest.chunks_exact(4).take(pixels).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(Raster { width: width as usize, height: height as usize, values: values.collect(), full_scale: None })
}
