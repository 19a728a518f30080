//! NumPy's archives, `.npz`: a ZIP file of `.npy` files, stored or deflated, of which one is the depth map.

use std::io::Read;

use flate2::read::DeflateDecoder;

use super::npy;
use super::raster::{MAX_PIXELS, Raster};
use crate::cursor::Cursor;
use crate::error::Problem;

/// The array that is meant where there are several, best first.
const NAMES: [&str; 7] = ["depth", "depths", "depth_map", "pred", "prediction", "data", "arr_0"];

/// End of the central directory (APPNOTE.TXT 4.3.16), without its comment, and the longest comment.
const END_BYTES: usize = 22;
const MAX_COMMENT_BYTES: usize = u16::MAX as usize;
const END_SIGNATURE: [u8; 4] = *b"PK\x05\x06";
const ENTRY_SIGNATURE: [u8; 4] = *b"PK\x01\x02";
const LOCAL_SIGNATURE: [u8; 4] = *b"PK\x03\x04";

/// Methods of compression.
const STORED: u16 = 0;
const DEFLATED: u16 = 8;

/// Largest array that is unpacked, bytes: the largest map in double precision and its header.
const MAX_UNPACKED_BYTES: u64 = 8 * MAX_PIXELS + (1 << 16);

/// A file within the archive, as the central directory has it.
#[derive(Debug, PartialEq)]
struct Entry<'a> {
    name: &'a str,
    method: u16,
    packed_bytes: u32,
    unpacked_bytes: u32,
    local_offset: u32,
}

pub(super) fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    let entries = entries(bytes)?;
    let arrays: Vec<&Entry<'_>> = entries.iter().filter(|e| e.name.ends_with(".npy")).collect();
    let named = |name: &&str| arrays.iter().find(|e| e.name.strip_suffix(".npy") == Some(*name)).copied();
    let chosen = match *arrays.as_slice() {
        [only] => Some(only),
        _ => NAMES.iter().find_map(named),
    };
    let chosen = chosen.ok_or_else(|| {
        let names: Vec<&str> = arrays.iter().take(8).map(|e| e.name).collect();
        wrong(format!("it holds [{}], none of which is named {}", names.join(", "), NAMES.join(", ")))
    })?;
    npy::parse(&unpack(bytes, chosen)?)
}

fn wrong(reason: impl Into<String>) -> Problem {
    Problem::WrongKind { expected: "an npz file", reason: reason.into() }
}

fn entries(bytes: &[u8]) -> Result<Vec<Entry<'_>>, Problem> {
    let earliest = bytes.len().saturating_sub(END_BYTES + MAX_COMMENT_BYTES);
    let end = bytes[earliest..].windows(END_SIGNATURE.len()).rposition(|w| w == END_SIGNATURE);
    let end = earliest + end.ok_or_else(|| wrong("it has no ZIP directory; it may be cut off"))?;
    let mut cursor = Cursor::new(&bytes[end..]);
    cursor.take(10)?;
    let count = u16_of(&mut cursor)?;
    cursor.take(4)?;
    let offset = cursor.u32()? as usize;
    let comment = u16_of(&mut cursor)?;
    cursor.take(comment.into())?;
    let directory = bytes.get(offset..end).ok_or_else(|| wrong("its directory lies outside the file"))?;
    let mut cursor = Cursor::new(directory);
    (0..count).map(|_| entry(&mut cursor)).collect()
}

fn entry<'a>(cursor: &mut Cursor<'a>) -> Result<Entry<'a>, Problem> {
    if cursor.take(4)? != ENTRY_SIGNATURE {
        return Err(wrong("its directory is damaged"));
    }
    cursor.take(4)?;
    let flags = u16_of(cursor)?;
    let method = u16_of(cursor)?;
    cursor.take(8)?;
    let (packed_bytes, unpacked_bytes) = (cursor.u32()?, cursor.u32()?);
    let [name, extra, comment] = [u16_of(cursor)?, u16_of(cursor)?, u16_of(cursor)?];
    cursor.take(8)?;
    let local_offset = cursor.u32()?;
    let name = cursor.take(name.into())?;
    cursor.take(usize::from(extra) + usize::from(comment))?;
    let name = std::str::from_utf8(name).map_err(|_| wrong("a name in it is not text"))?;
    if flags & 1 != 0 {
        return Err(wrong(format!("{name} is encrypted")));
    }
    if [packed_bytes, unpacked_bytes, local_offset].contains(&u32::MAX) {
        return Err(wrong(format!("{name} is larger than 4 GiB")));
    }
    Ok(Entry { name, method, packed_bytes, unpacked_bytes, local_offset })
}

fn unpack(bytes: &[u8], entry: &Entry<'_>) -> Result<Vec<u8>, Problem> {
    let outside = || wrong(format!("{} lies outside the file; it may be cut off", entry.name));
    let mut cursor = Cursor::new(bytes.get(entry.local_offset as usize..).ok_or_else(outside)?);
    if cursor.take(4)? != LOCAL_SIGNATURE {
        return Err(wrong(format!("{} has no header", entry.name)));
    }
    cursor.take(22)?;
    let (name, extra) = (u16_of(&mut cursor)?, u16_of(&mut cursor)?);
    cursor.take(usize::from(name) + usize::from(extra))?;
    let packed = cursor.take(entry.packed_bytes as usize)?;
    match entry.method {
        STORED => Ok(packed.to_vec()),
        DEFLATED => {
            let limit = u64::from(entry.unpacked_bytes).min(MAX_UNPACKED_BYTES);
            let mut out = Vec::new();
            let read = DeflateDecoder::new(packed).take(limit).read_to_end(&mut out);
            read.map_err(|e| wrong(format!("{} cannot be unpacked: {e}", entry.name)))?;
            Ok(out)
        }
        method => Err(wrong(format!("{} is compressed by method {method}; numpy only deflates", entry.name))),
    }
}

fn u16_of(cursor: &mut Cursor<'_>) -> Result<u16, Problem> {
    cursor.take(2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]))
}
