//! NumPy arrays, `.npy` (format: numpy.lib.format, versions 1 to 3): two dimensions, or more of which all but two are 1.

use half::f16;

use super::raster::{Raster, check_size};
use crate::error::Problem;

const MAGIC: &[u8] = b"\x93NUMPY";

/// The type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Element {
    Float(usize),
    Unsigned(usize),
    Signed(usize),
    Bool,
}

#[derive(Debug, PartialEq)]
struct Header {
    element: Element,
    is_big_endian: bool,
    is_column_major: bool,
    width: u64,
    height: u64,
}

pub(super) fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    let wrong = |reason: &str| Problem::WrongKind { expected: "an npy file", reason: reason.into() };
    let after_magic = bytes.strip_prefix(MAGIC).ok_or_else(|| wrong("it does not begin with \\x93NUMPY"))?;
    let (text, data) = match *after_magic {
        [1, _, a, b, ref rest @ ..] => rest.split_at_checked(u16::from_le_bytes([a, b]).into()),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => rest.split_at_checked(u32::from_le_bytes([a, b, c, d]) as usize),
        _ => return Err(wrong("its version is not 1, 2 or 3")),
    }
    .ok_or_else(|| wrong("the file ends within the header"))?;
    let text = std::str::from_utf8(text).map_err(|_| wrong("the header is not text"))?;
    let header = parse_header(text)?;
    let (size, big) = (header.element.bytes(), header.is_big_endian);
    let pixels = check_size(header.width, header.height, size as u64, data.len() as u64)?;
    let expected = pixels as u64 * size as u64;
    if (data.len() as u64) < expected {
        return Err(Problem::Truncated { expected, found: data.len() as u64 });
    }
    let numbers = data.chunks_exact(size).take(pixels).map(|bytes| header.element.number(bytes, big));
    let (width, height) = (header.width as usize, header.height as usize);
    let values = if header.is_column_major {
        let mut values = vec![0.0; pixels];
        for (i, number) in numbers.enumerate() {
            values[i % height * width + i / height] = number;
        }
        values
    } else {
        numbers.collect()
    };
    Ok(Raster { width, height, values, full_scale: header.element.full_scale() })
}

impl Element {
    fn bytes(self) -> usize {
        match self {
            Self::Float(n) | Self::Unsigned(n) | Self::Signed(n) => n,
            Self::Bool => 1,
        }
    }

    /// One element, in single precision: 24 bits are 0.1 mm at a kilometre.
    fn number(self, bytes: &[u8], is_big_endian: bool) -> f32 {
        // Right-aligned little-endian bytes in eight, the sign carried into the rest.
        let mut low_first = [0u8; 8];
        for (i, out) in low_first.iter_mut().take(bytes.len()).enumerate() {
            *out = bytes[if is_big_endian { bytes.len() - 1 - i } else { i }];
        }
        let whole = u64::from_le_bytes(low_first);
        match self {
            Self::Float(2) => f16::from_bits(whole as u16).to_f32(),
            Self::Float(4) => f32::from_bits(whole as u32),
            Self::Float(_) => f64::from_bits(whole) as f32,
            Self::Unsigned(_) => whole as f32,
            Self::Signed(n) => {
                let unused = 64 - 8 * n as u32;
                ((whole << unused) as i64 >> unused) as f32
            }
            Self::Bool => f32::from(u8::from(whole != 0)),
        }
    }

    fn full_scale(self) -> Option<f32> {
        match self {
            Self::Float(_) => None,
            Self::Unsigned(n) => Some((u64::MAX >> (64 - 8 * n as u32)) as f32),
            Self::Signed(n) => Some((i64::MAX >> (64 - 8 * n as u32)) as f32),
            Self::Bool => Some(1.0),
        }
    }
}

/// Reads `{'descr': '<f4', 'fortran_order': False, 'shape': (480, 640), }`.
fn parse_header(text: &str) -> Result<Header, Problem> {
    let missing = |what| Problem::Syntax { what, found: text.chars().take(80).collect() };
    let value = |key: &str| {
        let (_, rest) = text.split_once(&format!("'{key}'")).or_else(|| text.split_once(&format!("\"{key}\"")))?;
        Some(rest.trim_start().strip_prefix(':')?.trim_start())
    };
    let descr = value("descr").ok_or_else(|| missing("descr"))?;
    let quoted = descr.strip_prefix(['\'', '"']).and_then(|d| d.split(['\'', '"']).next());
    let descr = quoted.ok_or_else(|| missing("descr (arrays of records hold no depths)"))?;
    let (is_big_endian, element) = parse_descr(descr).ok_or_else(|| Problem::WrongType {
        column: "descr",
        expected: "f2, f4, f8 or a whole number",
        found: descr.chars().take(20).collect(),
    })?;
    let order = value("fortran_order").ok_or_else(|| missing("fortran_order"))?;
    let is_column_major = match (order.starts_with("True"), order.starts_with("False")) {
        (true, _) => true,
        (_, true) => false,
        _ => return Err(missing("fortran_order")),
    };
    let shape = value("shape").and_then(|s| s.strip_prefix('(')?.split_once(')')).ok_or_else(|| missing("shape"))?.0;
    let sides = shape.split(',').map(|n| n.trim().trim_end_matches('L')).filter(|n| !n.is_empty());
    let sides: Vec<u64> = sides.map(|n| n.parse().map_err(|_| missing("shape"))).collect::<Result<_, _>>()?;
    // Maps of one channel or in batches of one.
    let unit = |sides: &[u64]| sides.iter().all(|&n| n == 1);
    let (height, width) = match *sides.as_slice() {
        [height, width] => (height, width),
        [height, width, 1] | [1, height, width] => (height, width),
        [ref before @ .., height, width] if unit(before) => (height, width),
        [1, height, width, 1] => (height, width),
        _ => {
            return Err(Problem::OutOfRange {
                what: "the shape".into(),
                found: format!("({shape})"),
                expected: "(height, width): one array an image".into(),
            });
        }
    };
    Ok(Header { element, is_big_endian, is_column_major, width, height })
}

fn parse_descr(descr: &str) -> Option<(bool, Element)> {
    let is_big_endian = descr.starts_with('>');
    // `=` would be the writer's own order, which numpy never writes to files.
    let element = match descr.strip_prefix(['<', '>', '|'])? {
        "f2" => Element::Float(2),
        "f4" => Element::Float(4),
        "f8" => Element::Float(8),
        "u1" => Element::Unsigned(1),
        "u2" => Element::Unsigned(2),
        "u4" => Element::Unsigned(4),
        "i1" => Element::Signed(1),
        "i2" => Element::Signed(2),
        "i4" => Element::Signed(4),
        "i8" => Element::Signed(8),
        "u8" => Element::Unsigned(8),
        "b1" => Element::Bool,
        _ => return None,
    };
    Some((is_big_endian, element))
}
