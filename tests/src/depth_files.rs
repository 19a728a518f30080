//! Depth maps in the formats that the project reads and does not write, byte by byte, so that tests can damage them.

use epipole_scene::depth::DepthMap;

/// A little-endian TIFF of one strip of 32-bit floating-point grey (TIFF 6.0 §2, §19).
pub(crate) fn tiff(map: &DepthMap) -> Vec<u8> {
    const SHORT: u16 = 3;
    const LONG: u16 = 4;
    let samples: Vec<u8> = map.values_m().iter().flat_map(|v| v.to_le_bytes()).collect();
    let (width, height, length) = (map.width() as u32, map.height() as u32, samples.len() as u32);
    // Tag, type, value; in ascending order of the tags.
    let entries: [(u16, u16, u32); 9] = [
        (256, LONG, width),
        (257, LONG, height),
        (258, SHORT, 32),    // bits a sample
        (259, SHORT, 1),     // stored
        (262, SHORT, 1),     // black is zero
        (273, LONG, 8),      // where the strip begins
        (278, LONG, height), // rows in a strip
        (279, LONG, length), // bytes of the strip
        (339, SHORT, 3),     // floating point
    ];
    let mut bytes = b"II\x2a\0".to_vec();
    bytes.extend((8 + length).to_le_bytes());
    bytes.extend(&samples);
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(1u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend(0u32.to_le_bytes());
    bytes
}

/// An OpenEXR file of stored scan lines with the one channel `Z` of 32-bit floating point (OpenEXR File Layout).
pub(crate) fn exr(map: &DepthMap) -> Vec<u8> {
    let (width, height) = (map.width() as i32, map.height() as i32);
    let mut bytes = vec![0x76, 0x2F, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend(name.bytes().chain([0]));
        bytes.extend(kind.bytes().chain([0]));
        bytes.extend((value.len() as i32).to_le_bytes());
        bytes.extend(value);
    };
    let ints = |values: &[i32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    // Type 2 is FLOAT; then linearity, three reserved bytes, and a sampling of 1 by 1.
    let channels = [b"Z\0".to_vec(), ints(&[2, 0, 1, 1]), vec![0]].concat();
    attribute("channels", "chlist", &channels);
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &ints(&[0, 0, width - 1, height - 1]));
    attribute("displayWindow", "box2i", &ints(&[0, 0, width - 1, height - 1]));
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &floats(&[1.0]));
    attribute("screenWindowCenter", "v2f", &floats(&[0.0, 0.0]));
    attribute("screenWindowWidth", "float", &floats(&[1.0]));
    bytes.push(0);
    let line_bytes = 4 * map.width();
    let first = bytes.len() + 8 * map.height();
    for line in 0..map.height() {
        bytes.extend(((first + line * (8 + line_bytes)) as u64).to_le_bytes());
    }
    for (line, values) in map.values_m().chunks_exact(map.width()).enumerate() {
        bytes.extend(ints(&[line as i32, line_bytes as i32]));
        bytes.extend(floats(values));
    }
    bytes
}
