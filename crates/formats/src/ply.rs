//! Point clouds as PLY: written binary, read in any of the three encodings with any further properties.

use std::fs;
use std::path::Path;
use std::str::SplitAsciiWhitespace;

use epipole_scene::Reconstruction;
use glam::DVec3;

use crate::atomic::atomic_write;
use crate::cursor::Cursor;
use crate::error::{FormatError, Location, Problem};

/// Points, and their colours where the file has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions, in the file's units.
    pub positions: Vec<DVec3>,
    /// sRGB, one per position.
    pub rgb: Option<Vec<[u8; 3]>>,
}

/// Writes the points of a reconstruction: binary little-endian, position in `f32`, colour in bytes. Atomic.
///
/// # Errors
/// Whatever the file system refuses.
pub fn write_points(path: &Path, reconstruction: &Reconstruction) -> Result<(), FormatError> {
    let bytes = points_file(reconstruction);
    atomic_write(path, |writer| writer.write_all(&bytes).map_err(|e| FormatError::io(path, e)))
}

/// The file that [`write_points`] writes, in memory.
pub fn points_file(reconstruction: &Reconstruction) -> Vec<u8> {
    transformed_points_file(reconstruction, |p| p)
}

pub(crate) fn transformed_points_file(reconstruction: &Reconstruction, transform: impl Fn(DVec3) -> DVec3) -> Vec<u8> {
    let points = &reconstruction.points;
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )
    .into_bytes();
    for point in points {
        out.extend(transform(point.position).as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes));
        out.extend(point.rgb);
    }
    out
}

/// Reads the vertices of a PLY file.
///
/// # Errors
/// A header that cannot be understood, a missing `x`, `y` or `z`, a file that is cut off.
pub fn read_points(path: &Path) -> Result<PointCloud, FormatError> {
    let bytes = fs::read(path).map_err(|e| FormatError::io(path, e))?;
    parse(&bytes).map_err(|problem| {
        FormatError::invalid(Location::file(path), problem, "give a PLY file with vertices that have x, y and z")
    })
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Scalar {
    Int { bytes: usize, signed: bool },
    Float32,
    Float64,
}

impl Scalar {
    fn from_name(name: &str) -> Option<Self> {
        let int = |bytes, signed| Some(Self::Int { bytes, signed });
        match name {
            "char" | "int8" => int(1, true),
            "uchar" | "uint8" => int(1, false),
            "short" | "int16" => int(2, true),
            "ushort" | "uint16" => int(2, false),
            "int" | "int32" => int(4, true),
            "uint" | "uint32" => int(4, false),
            "float" | "float32" => Some(Self::Float32),
            "double" | "float64" => Some(Self::Float64),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::Int { bytes, .. } => bytes,
            Self::Float32 => 4,
            Self::Float64 => 8,
        }
    }

    /// The value of at most eight bytes, least significant first.
    fn value(self, little: [u8; 8]) -> f64 {
        let bits = u64::from_le_bytes(little);
        match self {
            Self::Float64 => f64::from_bits(bits),
            Self::Float32 => f32::from_bits(bits as u32).into(),
            Self::Int { signed: false, .. } => bits as f64,
            Self::Int { bytes, signed: true } => {
                let unused = 64 - 8 * bytes as u32;
                ((bits << unused).cast_signed() >> unused) as f64
            }
        }
    }
}

#[derive(Debug)]
struct Property {
    name: String,
    /// The type of the length, for a list.
    length: Option<Scalar>,
    scalar: Scalar,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

fn syntax(what: &'static str, found: &str) -> Problem {
    Problem::Syntax { what, found: found.chars().take(60).collect() }
}

/// The encoding, the elements, and where the body begins.
fn header(bytes: &[u8]) -> Result<(Encoding, Vec<Element>, usize), Problem> {
    if !bytes.starts_with(b"ply") {
        return Err(Problem::WrongKind { expected: "a PLY file", reason: "it does not begin with `ply`".into() });
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut start = 0;
    loop {
        let rest = &bytes[start..];
        let length = rest.iter().position(|&b| b == b'\n').ok_or(Problem::Nothing("end_header lines"))?;
        let line = String::from_utf8_lossy(&rest[..length]);
        start += length + 1;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["format", name, ..] => {
                encoding = Some(match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    other => return Err(syntax("a PLY format", other)),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| syntax("a number of elements", count))?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref kind @ .., name] => {
                let element = elements.last_mut().ok_or_else(|| syntax("an element before its properties", &line))?;
                let scalar = |name: &str| Scalar::from_name(name).ok_or_else(|| syntax("a PLY type", name));
                let (length, scalar) = match kind {
                    ["list", length, item] => (Some(scalar(length)?), scalar(item)?),
                    [item] => (None, scalar(item)?),
                    _ => return Err(syntax("a property", &line)),
                };
                element.properties.push(Property { name: name.to_owned(), length, scalar });
            }
            ["end_header"] => break,
            _ => {}
        }
    }
    Ok((encoding.ok_or(Problem::Nothing("format lines"))?, elements, start))
}

/// The body, one number after another whatever the encoding.
enum Body<'a> {
    Text(SplitAsciiWhitespace<'a>),
    Binary(Cursor<'a>, Encoding),
}

impl Body<'_> {
    fn next(&mut self, scalar: Scalar) -> Result<f64, Problem> {
        match self {
            Self::Text(words) => {
                let word = words.next().ok_or_else(|| syntax("a number", "the end of the file"))?;
                word.parse().map_err(|_| syntax("a number", word))
            }
            Self::Binary(cursor, encoding) => {
                let mut little = [0; 8];
                let bytes = cursor.take(scalar.bytes())?;
                little[..bytes.len()].copy_from_slice(bytes);
                if *encoding == Encoding::BigEndian {
                    little[..bytes.len()].reverse();
                }
                Ok(scalar.value(little))
            }
        }
    }
}

fn parse(bytes: &[u8]) -> Result<PointCloud, Problem> {
    let (encoding, elements, start) = header(bytes)?;
    let rest = &bytes[start..];
    let mut body = match encoding {
        Encoding::Ascii => {
            Body::Text(std::str::from_utf8(rest).map_err(|_| syntax("text", "other bytes"))?.split_ascii_whitespace())
        }
        binary => Body::Binary(Cursor::new(rest), binary),
    };
    for element in &elements {
        let is_vertex = element.name == "vertex";
        let find = |name: &str| element.properties.iter().position(|p| p.name == name && p.length.is_none());
        let xyz = [find("x"), find("y"), find("z")];
        let rgb = [find("red"), find("green"), find("blue")];
        let ([Some(x), Some(y), Some(z)], true) = (xyz, is_vertex) else {
            if is_vertex {
                return Err(Problem::Nothing("properties x, y and z"));
            }
            skip(&mut body, element)?;
            continue;
        };
        // A record takes at least a byte: the count is bounded by what is there.
        if element.count > rest.len() as u64 {
            return Err(Problem::Truncated { expected: start as u64 + element.count, found: bytes.len() as u64 });
        }
        let mut cloud = PointCloud { positions: Vec::new(), rgb: None };
        let mut colours = Vec::new();
        let mut values = vec![0.0; element.properties.len()];
        for _ in 0..element.count {
            read_record(&mut body, element, &mut values)?;
            cloud.positions.push(DVec3::new(values[x], values[y], values[z]));
            if let [Some(r), Some(g), Some(b)] = rgb {
                // Floats are 0–1, integers 0–255; `as` saturates and maps NaN to 0.
                colours.push([r, g, b].map(|i| match element.properties[i].scalar {
                    Scalar::Int { .. } => values[i] as u8,
                    _ => (values[i] * 255.0).round() as u8,
                }));
            }
        }
        cloud.rgb = (!colours.is_empty()).then_some(colours);
        return Ok(cloud);
    }
    Err(Problem::Nothing("vertices"))
}

fn read_record(body: &mut Body<'_>, element: &Element, values: &mut [f64]) -> Result<(), Problem> {
    for (property, value) in element.properties.iter().zip(values) {
        let Some(length) = property.length else {
            *value = body.next(property.scalar)?;
            continue;
        };
        // A length that is no count (negative, NaN) becomes 0 by `as`; the cursor ends one that is too large.
        for _ in 0..body.next(length)? as u64 {
            body.next(property.scalar)?;
        }
    }
    Ok(())
}

fn skip(body: &mut Body<'_>, element: &Element) -> Result<(), Problem> {
    if element.properties.is_empty() {
        return Ok(());
    }
    let mut values = vec![0.0; element.properties.len()];
    (0..element.count).try_for_each(|_| read_record(body, element, &mut values))
}

#[cfg(test)]
mod tests {
    use epipole_scene::Point;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn written_points_read_back() {
        let point = |id, x: f64| Point {
            id,
            position: DVec3::new(x, -0.5, 8.0),
            rgb: [1, 2, 255],
            error_px: 0.0,
            observations: Vec::new(),
        };
        let reconstruction = Reconstruction { points: vec![point(1, 0.25), point(2, -4.0)], ..Default::default() };
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("p.ply");
        write_points(&path, &reconstruction).expect("write");
        let cloud = read_points(&path).expect("read");
        assert_eq!(cloud.positions, [DVec3::new(0.25, -0.5, 8.0), DVec3::new(-4.0, -0.5, 8.0)]);
        assert_eq!(cloud.rgb, Some(vec![[1, 2, 255]; 2]));
    }

    #[test]
    fn ascii_lists_and_extra_properties_are_passed_over() {
        let text = b"ply\nformat ascii 1.0\ncomment x\nelement face 1\nproperty list uchar int i\nelement vertex 2\n\
            property double y\nproperty float x\nproperty list uchar float w\nproperty int z\nend_header\n\
            3 0 1 2\n2 1 2 0.5 0.5 -3\n5 4 0 6\n";
        let cloud = parse(text).expect("parse");
        assert_eq!(cloud.positions, [DVec3::new(1.0, 2.0, -3.0), DVec3::new(4.0, 5.0, 6.0)]);
        assert_eq!(cloud.rgb, None);
    }

    #[test]
    fn big_endian_and_signed_integers() {
        let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty short x\nproperty float y\nproperty double z\nend_header\n".to_vec();
        bytes.extend((-300i16).to_be_bytes());
        bytes.extend(1.5f32.to_be_bytes());
        bytes.extend((-0.1f64).to_be_bytes());
        assert_eq!(parse(&bytes).expect("parse").positions, [DVec3::new(-300.0, 1.5, -0.1)]);
        bytes.pop();
        assert!(matches!(parse(&bytes), Err(Problem::Truncated { .. })));
    }

    #[test]
    fn the_fused_cloud_has_its_points() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/sevenscenes/gt/cloud.ply"));
        if !path.exists() {
            return println!("skipped: no shared data");
        }
        let cloud = read_points(path).expect("read");
        assert_eq!(cloud.positions.len(), 125_494);
        assert!(cloud.positions.iter().all(|p| p.is_finite() && p.length() < 20.0));
    }

    proptest! {
        #[test]
        fn arbitrary_bodies_never_panic(
            header in "(format (ascii|binary_little_endian|binary_big_endian) 1.0\n)?(element (vertex|face) [0-9]{1,20}\n(property (list uchar )?(float|int8|double) [xyzw]\n){0,4}){0,3}",
            body in proptest::collection::vec(any::<u8>(), 0..100),
        ) {
            let mut bytes = format!("ply\n{header}end_header\n").into_bytes();
            bytes.extend(body);
            let _ = parse(&bytes);
        }
    }
}
