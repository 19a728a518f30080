//! The readers on files made here byte by byte, on damaged ones, and on arbitrary bytes; then a folder for a graph.

use std::fs;
use std::io::{Cursor, Write};
use std::sync::Arc;

use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::depth::{DepthKind, DepthMap, DepthOptions};
use epipole_scene::{ViewGraph, ViewImage};
use glam::DVec2;
use half::f16;
use proptest::prelude::*;

use super::raster::Raster;
use super::*;

/// An npy file of version 1 with a header as numpy writes it.
fn npy_file(descr: &str, column_major: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if column_major { "True" } else { "False" };
    let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

/// A ZIP file of one entry, as numpy's `savez` (method 0) and `savez_compressed` (method 8) write it.
fn npz_file(name: &str, content: &[u8], method: u16) -> Vec<u8> {
    let packed = if method == 8 {
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(content).and_then(|()| encoder.finish()).expect("deflated")
    } else {
        content.to_vec()
    };
    let name_bytes = (name.len() as u16).to_le_bytes();
    // numpy forces ZIP64 in the local header: sizes of 2³² − 1 there and the true ones in an extra field.
    let mut bytes = b"PK\x03\x04\x2d\0\0\0".to_vec();
    bytes.extend(method.to_le_bytes());
    bytes.extend([0; 8]);
    bytes.extend([0xFF; 8]);
    bytes.extend(name_bytes);
    bytes.extend(20u16.to_le_bytes());
    bytes.extend(name.as_bytes());
    bytes.extend([1, 0, 16, 0]);
    bytes.extend((content.len() as u64).to_le_bytes());
    bytes.extend((packed.len() as u64).to_le_bytes());
    bytes.extend(&packed);
    let directory = bytes.len() as u32;
    bytes.extend(b"PK\x01\x02\x2d\x03\x2d\0\0\0");
    bytes.extend(method.to_le_bytes());
    bytes.extend([0; 8]);
    bytes.extend((packed.len() as u32).to_le_bytes());
    bytes.extend((content.len() as u32).to_le_bytes());
    bytes.extend(name_bytes);
    bytes.extend([0; 16]);
    bytes.extend(name.as_bytes());
    let length = bytes.len() as u32 - directory;
    bytes.extend(b"PK\x05\x06\0\0\0\0\x01\0\x01\0");
    bytes.extend(length.to_le_bytes());
    bytes.extend(directory.to_le_bytes());
    bytes.extend([0; 2]);
    bytes
}

fn tiff_files() -> Vec<Vec<u8>> {
    use ::tiff::encoder::{Compression, TiffEncoder, colortype};
    let mut out = vec![Cursor::new(Vec::new()), Cursor::new(Vec::new()), Cursor::new(Vec::new())];
    let [plain, lzw, deflated] = out.as_mut_slice() else { return Vec::new() };
    let wide = SIX.map(f64::from);
    let whole = SIX.map(|v| v as u16);
    let write = || -> ::tiff::TiffResult<()> {
        TiffEncoder::new(plain)?.write_image::<colortype::Gray32Float>(3, 2, &SIX)?;
        let mut encoder = TiffEncoder::new(lzw)?.with_compression(Compression::Lzw);
        encoder.write_image::<colortype::Gray64Float>(3, 2, &wide)?;
        let mut encoder = TiffEncoder::new(deflated)?.with_compression(Compression::Deflate(Default::default()));
        encoder.write_image::<colortype::Gray16>(3, 2, &whole)
    };
    write().expect("written");
    out.into_iter().map(Cursor::into_inner).collect()
}

fn exr_file(channels: &[(&str, &[f32; 6])], half: bool) -> Vec<u8> {
    use ::exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
    let samples = |values: &[f32]| match half {
        true => FlatSamples::F16(values.iter().map(|&v| f16::from_f32(v)).collect()),
        false => FlatSamples::F32(values.to_vec()),
    };
    let list = channels.iter().map(|(name, values)| AnyChannel::new(*name, samples(&values[..]))).collect();
    let image = Image::from_channels((3, 2), AnyChannels::sort(list));
    let mut out = Cursor::new(Vec::new());
    image.write().to_buffered(&mut out).expect("written");
    out.into_inner()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

const SIX: [f32; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];

fn six(raster: &Raster) {
    assert_eq!((raster.width, raster.height), (3, 2));
    assert_eq!(raster.values, SIX);
}

#[test]
fn arrays_of_every_type_and_order_read_the_same() {
    let f16s: Vec<u8> = SIX.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()).collect();
    let f64s: Vec<u8> = SIX.iter().flat_map(|&v| f64::from(v).to_le_bytes()).collect();
    let f64s_big: Vec<u8> = SIX.iter().flat_map(|&v| f64::from(v).to_be_bytes()).collect();
    let u16s: Vec<u8> = SIX.iter().flat_map(|&v| (v as u16).to_le_bytes()).collect();
    let i32s: Vec<u8> = SIX.iter().flat_map(|&v| (v as i32).to_le_bytes()).collect();
    for (descr, data) in
        [("<f2", &f16s), ("<f4", &floats(&SIX)), ("<f8", &f64s), (">f8", &f64s_big), ("<u2", &u16s), ("<i4", &i32s)]
    {
        six(&parse(&npy_file(descr, false, "(2, 3)", data)).expect(descr));
    }
    six(&parse(&npy_file("<f4", true, "(2, 3)", &floats(&[1.0, 4.0, 2.0, 5.0, 3.0, 6.0]))).expect("column-major"));
    for shape in ["(2, 3, 1)", "(1, 2, 3)", "(1, 1, 2, 3)", "(1, 2, 3, 1)"] {
        six(&parse(&npy_file("<f4", false, shape, &floats(&SIX))).expect(shape));
    }
    let inner = npy_file("<f4", false, "(2, 3)", &floats(&SIX));
    for (name, method) in [("depth.npy", 0), ("anything.npy", 8)] {
        six(&parse(&npz_file(name, &inner, method)).expect(name));
    }
    let mut colmap = b"3&2&1&".to_vec();
    colmap.extend(floats(&SIX));
    six(&parse(&colmap).expect("dense COLMAP"));
    for (bytes, name) in tiff_files().into_iter().zip(["TIFF", "TIFF f8, LZW", "TIFF u2, deflated"]) {
        six(&parse(&bytes).expect(name));
    }
    for (channel, half) in [("Z", false), ("Depth.V", true), ("anything", false)] {
        six(&parse(&exr_file(&[(channel, &SIX)], half)).expect(channel));
    }
    six(&parse(&exr_file(&[("A", &[0.0; 6]), ("B", &[0.0; 6]), ("R", &[9.0; 6]), ("Z", &SIX)], false))
        .expect("Z of many"));
}

#[test]
fn what_is_no_map_is_said() {
    let said = |bytes: &[u8]| parse(bytes).err().map(|problem| problem.to_string()).unwrap_or_default();
    let data = floats(&SIX);
    for (bytes, mentions) in [
        (vec![], "empty"),
        (b"depth".to_vec(), "first bytes"),
        (npy_file("<f4", false, "(2, 4)", &data), "cut off"),
        (npy_file("<f4", false, "(100000000000, 4)", &data), "at most"),
        (npy_file("<f4", false, "(18446744073709551615, 18446744073709551615)", &data), "at most"),
        (npy_file("<f4", false, "(8000, 8000)", &data), "cut off"),
        (npy_file("<f4", false, "(0, 4)", &data), "empty"),
        (npy_file("<f4", false, "(6,)", &data), "shape"),
        (npy_file("<f4", false, "(2, 3, 3)", &data), "one array an image"),
        (npy_file("<c8", false, "(2, 3)", &data), "c8"),
        (npy_file("<f4", false, "(2, -3)", &data), "shape"),
        (b"\x93NUMPY\x09\x00".to_vec(), "version"),
        (b"\x93NUMPY\x01\x00\xff\xff{}".to_vec(), "within the header"),
        (b"PK\x03\x04".to_vec(), "directory"),
        (npz_file("a.txt", b"x", 0), "none of which"),
        (npz_file("a.npy", b"x", 99), "method 99"),
        (b"3&2&3&".to_vec(), "normal map"),
        (b"3&2&".to_vec(), "width&height&channels&"),
        (b"3&2&1&xx".to_vec(), "cut off"),
        (b"\x89PNG\r\n\x1a\n".to_vec(), "PNG"),
    ] {
        assert!(said(&bytes).contains(mentions), "`{}` does not mention `{mentions}`", said(&bytes));
    }
    let eight_bits = Raster { width: 1, height: 1, values: vec![9.0], full_scale: Some(255.0) };
    assert!(eight_bits.into_depths(None).is_err_and(|p| p.to_string().contains("8 bits")));
}

#[test]
fn written_maps_read_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = DepthMap::new(3, 2, vec![0.5, 1.25, f32::NAN, 65.534, 70.0, 0.0]).expect("six values");
    let (png, npy) = (folder.path().join("a.png"), folder.path().join("a.npy"));
    write_depth_png(&png, &map, 0.001).expect("written");
    let read = read_depth_map(&png, None).expect("read");
    let values = [read.get(0, 0), read.get(1, 0), read.get(2, 0), read.get(0, 1), read.get(1, 1), read.get(2, 1)];
    assert_eq!(values, [Some(0.5), Some(1.25), None, Some(65.534), None, None]);
    assert_eq!(read_depth_map(&png, Some(0.002)).expect("read").get(0, 0), Some(1.0));
    write_depth_npy(&npy, &map).expect("written");
    let read = read_depth_map(&npy, None).expect("read");
    assert!(read.values_m().iter().zip(map.values_m()).all(|(a, b)| a == b || (a.is_nan() && b.is_nan())));
    assert_eq!(fs::read(&npy).expect("bytes").len(), 128 + 24, "data begin at a multiple of 64 bytes");
    let error = read_depth_map(&folder.path().join("b.png"), None).expect_err("no such file");
    assert!(error.to_string().contains("b.png"));
}

/// Sentinels of whole numbers are no depths, those of floating-point numbers are NaN and infinity.
#[test]
fn zero_and_the_largest_number_are_sentinels() {
    let bytes: Vec<u8> = [0u16, 1, 65_534, 65_535].iter().flat_map(|v| v.to_le_bytes()).collect();
    let map = parse(&npy_file("<u2", false, "(1, 4)", &bytes)).and_then(|r| r.into_depths(None)).expect("a map");
    assert_eq!([0, 1, 2, 3].map(|c| map.get(c, 0)), [None, Some(0.001), Some(65.534), None]);
}

fn graph(names: &[&str]) -> ViewGraph {
    let keypoints: Arc<[DVec2]> = Arc::from([DVec2::new(5.0, 5.0), DVec2::new(2.0, 8.0), DVec2::new(-3.0, 1.0)]);
    let image = |(i, name): (usize, &&str)| ViewImage {
        id: i as u32 + 1,
        name: (*name).to_owned(),
        camera: 0,
        keypoints_px: keypoints.clone(),
        depths: None,
    };
    let camera = Camera::with_focal(1, CameraModel::SimplePinhole, 10, 10, 10.0);
    ViewGraph { cameras: vec![camera], images: names.iter().enumerate().map(image).collect(), pairs: Vec::new() }
}

#[test]
fn a_folder_gives_depths_and_says_what_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let map = DepthMap::new(5, 5, vec![2.0; 25]).expect("a map");
    write_depth_png(&at("a.depth.png"), &map, 0.001).expect("written");
    write_depth_npy(&at("b.npy"), &map).expect("written");
    fs::write(at("c.png"), b"\x89PNG cut off").expect("written");
    let sure = DepthMap::new(5, 5, vec![0.25; 25]).expect("confidences");
    write_depth_npy(&at("b_confidence.npy"), &sure).expect("written");
    let mut graph = graph(&["a.color.jpg", "b.jpg", "c.jpg", "d.jpg"]);
    let options = DepthOptions::default();
    let mut calls = 0;
    let mut count = |done, total| {
        calls += 1;
        done <= total
    };
    let input = attach_depths(&mut graph, folder.path(), None, &options, &mut count).expect("a folder");
    assert_eq!((input.maps, input.keypoints, input.keypoints_with_depth, calls), (2, 6, 4, 4));
    assert_eq!((input.missing.as_slice(), input.refused.outside_map), (&["d.jpg".to_owned()][..], 2));
    assert_eq!(input.unreadable.len(), 1);
    assert!(input.unreadable[0].image == "c.jpg" && input.unreadable[0].message.contains("c.png"));
    let depth = |image: usize| graph.images[image].depths.as_ref().and_then(|d| d.get(0)).expect("a depth");
    assert_eq!(depth(0).z_m, 2.0);
    assert!((depth(1).relative_sigma / depth(0).relative_sigma - 2.0).abs() < 1e-6);
    assert!(graph.images[2].depths.is_none() && graph.images[3].depths.is_none());
}

#[test]
fn one_map_for_two_images_is_taken_by_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = DepthMap::new(5, 5, vec![2.0; 25]).expect("a map");
    write_depth_npy(&folder.path().join("1.npy"), &map).expect("written");
    let mut graph = graph(&["cam0/1.jpg", "cam1/1.jpg"]);
    let options = DepthOptions::default();
    let input = attach_depths(&mut graph, folder.path(), None, &options, &mut |_, _| true).expect("a folder");
    assert_eq!((input.maps, input.unreadable.len()), (0, 2));
    assert!(input.unreadable[0].message.contains("more than one image"));
}

#[test]
fn a_sidecar_moves_the_maps() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = DepthMap::new(20, 20, vec![2.0; 400]).expect("a map");
    write_depth_npy(&folder.path().join("1.npy"), &map).expect("written");
    let text = r#"{"depth_camera": {"model": "SIMPLE_PINHOLE", "width": 20, "height": 20, "params": [10, 10, 10]},
        "color_from_depth": {"rotation_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, 0.5]}}"#;
    fs::write(folder.path().join(SIDECAR_NAME), text).expect("written");
    let mut graph = graph(&["1.jpg"]);
    let options = DepthOptions { kind: DepthKind::Z, ..Default::default() };
    attach_depths(&mut graph, folder.path(), None, &options, &mut |_, _| true).expect("a folder");
    let found = graph.images[0].depths.as_ref().and_then(|d| d.get(0)).expect("a depth");
    assert!((found.z_m - 2.5).abs() < 1e-6, "{found:?}");
    fs::write(folder.path().join(SIDECAR_NAME), "{").expect("written");
    let error = attach_depths(&mut graph, folder.path(), None, &options, &mut |_, _| true).expect_err("bad sidecar");
    assert!(error.to_string().contains(SIDECAR_NAME), "{error}");
}

#[test]
fn bad_sidecars_are_refused_with_a_reason() {
    let camera = r#"{"model": "PINHOLE", "width": 4, "height": 4, "params": [1, 1, 2, 2]}"#;
    for (text, mentions) in [
        ("", "JSON"),
        ("[1]", "JSON"),
        (r#"{"depth_kamera": 1}"#, "depth_kamera"),
        (r#"{"depth_camera": {"model": "PINHOLE", "width": 4, "height": 4, "params": [1]}}"#, "4"),
        (r#"{"depth_camera": {"model": "PINHOLE", "width": 0, "height": 4, "params": [1, 1, 2, 2]}}"#, "0"),
        (r#"{"depth_camera": {"model": "LENS", "width": 4, "height": 4, "params": [1]}}"#, "LENS"),
        (r#"{"color_from_depth": {"rotation_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, 0]}}"#, "depth_camera"),
        (
            &format!(
                r#"{{"depth_camera": {camera}, "color_from_depth": {{"rotation_wxyz": [1, 1, 0, 0], "translation_m": [0, 0, 0]}}}}"#
            ),
            "rotation_wxyz",
        ),
        (r#"{"full_confidence": -1}"#, "full_confidence"),
    ] {
        let said = sidecar::parse(text).err().map(|p| p.to_string()).unwrap_or_default();
        assert!(said.contains(mentions), "{text}: `{said}` does not mention `{mentions}`");
    }
    let benchmark = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/depth/sevenscenes.json");
    assert!(DepthSidecar::read(Path::new(benchmark)).expect("the benchmark's").needs_registration());
}

/// Sound files of all formats, to be damaged.
fn sound_files() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a folder");
    let map = DepthMap::new(9, 7, (1..=63).map(|i| i as f32 / 8.0).collect()).expect("a map");
    let (png, npy) = (folder.path().join("a.png"), folder.path().join("a.npy"));
    write_depth_png(&png, &map, 0.001).expect("written");
    write_depth_npy(&npy, &map).expect("written");
    let npy = fs::read(&npy).expect("read");
    let mut colmap = b"9&7&1&".to_vec();
    colmap.extend(floats(map.values_m()));
    let mut files = tiff_files();
    files.push(exr_file(&[("Z", &SIX)], false));
    files.extend([npz_file("depth.npy", &npy, 8), npz_file("depth.npy", &npy, 0), npy, colmap]);
    files.push(fs::read(&png).expect("read"));
    files
}

#[test]
fn damaged_files_are_errors_or_maps_but_never_panics() {
    for whole in sound_files() {
        assert!(parse(&whole).is_ok());
        for length in 0..whole.len() {
            // A PNG file ends with twelve bytes that hold nothing.
            let is_whole = whole.starts_with(b"\x89PNG") && length + 12 > whole.len();
            assert!(parse(&whole[..length]).is_err() || is_whole, "cut at {length} of {}", whole.len());
        }
        for at in 0..whole.len() {
            for mask in [0x01, 0x80, 0xFF] {
                let mut bytes = whole.clone();
                bytes[at] ^= mask;
                let _ = parse(&bytes);
            }
        }
    }
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(
        start in proptest::sample::select(vec![
            &b"\x89PNG\r\n\x1a\n"[..], b"II\x2a\0\x08\0\0\0", b"MM\0\x2a\0\0\0\x08", b"\x76\x2f\x31\x01\x02\0\0\0", b"\x93NUMPY\x01\x00", b"\x93NUMPY\x02\x00", b"PK\x03\x04", b"PK\x05\x06", b"7&", b"",
        ]),
        rest in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        let mut bytes = start.to_vec();
        bytes.extend(rest);
        let _ = parse(&bytes);
    }

    #[test]
    fn arbitrary_headers_never_panic(
        descr in "[<>|=]?[fuicb][1248]?",
        shape in "\\((-?[0-9]{0,20}, ?){0,4}[0-9]{0,5}\\)?",
        column_major in any::<bool>(),
        data in proptest::collection::vec(any::<u8>(), 0..64),
    ) {
        let _ = parse(&npy_file(&descr, column_major, &shape, &data));
    }

    #[test]
    fn arbitrary_sidecars_never_panic(text in "\\PC{0,80}") {
        let _ = sidecar::parse(&text);
    }
}
