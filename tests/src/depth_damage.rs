//! Ways in which a folder of depth maps arrives broken, applied to a sound one.
//!
//! Each is what people really bring: interrupted copies, the wrong picture under the right name, another unit, another scene.

use std::fs;
use std::path::{Path, PathBuf};

use epipole_formats::FormatError;
use epipole_formats::depth::{SIDECAR_NAME, read_depth_map, write_depth_npy, write_depth_png};

use crate::depth_files::{exr, tiff};

/// What must come of a damaged folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// A typed error that names the file; nothing is reconstructed, since all maps would be read wrongly.
    Error,
    /// The map is reported with its file; its image goes without depth and the model is metric by the others.
    Unreadable,
    /// The image is reported as one without a map; the model is metric by the others.
    Missing,
    /// The map is reported as contradicting the others, which decide the scale.
    SetApart,
    /// Nothing to complain of in the files: the model is metric by what there is.
    Accepted,
    /// The model is not metric, and that is no error.
    NotMetric,
}

/// One kind of damage.
pub struct DepthDamage {
    /// A short name, fit for a folder.
    pub name: &'static str,
    /// What must come of it.
    pub verdict: Verdict,
    /// What the message must contain: the file, or what is wrong. Of several, all.
    pub mentions: &'static [&'static str],
    kind: Kind,
}

/// What is done, to the first map unless said otherwise.
enum Kind {
    /// Written in a format, then cut to this share of its length.
    Cut(Format, f64),
    /// Written in a format and left whole.
    Rewritten(Format),
    /// Replaced by these bytes under this ending.
    Replaced(&'static str, &'static [u8]),
    /// Every value changed.
    Values(fn(f32) -> f32),
    /// Every value of every map changed, knowing its index in the folder.
    AllValues(fn(f32, usize) -> f32),
    /// Another file added to the folder.
    Beside(&'static str, &'static [u8]),
    /// Removed.
    Removed,
    /// All maps removed.
    AllRemoved,
    /// The folder removed.
    NoFolder,
    /// A file where the folder was.
    NotAFolder,
}

#[derive(Clone, Copy)]
enum Format {
    Png,
    Npy,
    Tiff,
    Exr,
}

impl Format {
    fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Npy => "npy",
            Self::Tiff => "tiff",
            Self::Exr => "exr",
        }
    }
}

/// Why a folder could not be damaged.
#[derive(Debug, thiserror::Error)]
pub enum DepthDamageError {
    /// A map could not be read or written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The folder could not be changed.
    #[error("{path}: {source}; give a folder of depth maps that the synthesiser wrote")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

use Format::{Exr, Npy, Png, Tiff};
use Kind::{AllRemoved, AllValues, Beside, Cut, NoFolder, NotAFolder, Removed, Replaced, Rewritten, Values};
use Verdict::{Accepted, Error, Missing, NotMetric, SetApart, Unreadable};

const fn damage(name: &'static str, verdict: Verdict, mentions: &'static [&'static str], kind: Kind) -> DepthDamage {
    DepthDamage { name, verdict, mentions, kind }
}

/// Every kind of damage, to the maps of `fixtures/orbit`, whose first is 00000.png.
pub const ALL: &[DepthDamage] = &[
    // One file that is no whole map.
    damage("png_cut", Unreadable, &["00000.png"], Cut(Png, 0.5)),
    damage("png_cut_in_header", Unreadable, &["00000.png"], Cut(Png, 0.01)),
    damage("npy_cut", Unreadable, &["00000.npy", "cut off"], Cut(Npy, 0.9)),
    damage("tiff_cut", Unreadable, &["00000.tiff"], Cut(Tiff, 0.5)),
    damage("exr_cut", Unreadable, &["00000.exr"], Cut(Exr, 0.5)),
    damage("empty_file", Unreadable, &["00000.png", "empty"], Replaced("png", b"")),
    damage("text", Unreadable, &["00000.png", "first bytes"], Replaced("png", b"depth of 00000.jpg\n")),
    damage("eight_bits", Unreadable, &["00000.png", "8 bits"], Replaced("png", GREY_8)),
    damage("photograph", Unreadable, &["00000.png", "Rgb"], Replaced("png", RGB_8)),
    damage("size_of_a_planet", Unreadable, &["00000.png"], Replaced("png", HUGE)),
    damage("complex_numbers", Unreadable, &["00000.npy", "c8"], Replaced("npy", COMPLEX)),
    damage("one_row_of_numbers", Unreadable, &["00000.npy", "shape"], Replaced("npy", ONE_ROW)),
    damage("confidence_of_another_size", Unreadable, &["00000_confidence.png"], Beside("00000_confidence.png", GREY_8)),
    damage("confidence_is_text", Unreadable, &["00000_confidence.png"], Beside("00000_confidence.png", b"high")),
    // Sound files in formats that the fixture is not in.
    damage("as_npy", Accepted, &[], Rewritten(Npy)),
    damage("as_tiff", Accepted, &[], Rewritten(Tiff)),
    damage("as_exr", Accepted, &[], Rewritten(Exr)),
    // Values.
    damage("all_zero", Accepted, &[], Values(|_| 0.0)),
    damage("all_nan", Accepted, &[], Values(|_| f32::NAN)),
    damage("all_infinite", Accepted, &[], Values(|_| f32::INFINITY)),
    damage("negative", Accepted, &[], Values(|z| -z)),
    damage("one_pixel", Accepted, &[], Replaced("png", GREY_16)),
    damage("in_feet", SetApart, &["00000.jpg"], Values(|z| z / 0.3048)),
    damage("zero_everywhere", NotMetric, &[], AllValues(|_, _| 0.0)),
    damage("of_another_scene", NotMetric, &["contradict"], AllValues(scrambled)),
    // Files that are not there.
    damage("one_map_missing", Missing, &["00000.jpg"], Removed),
    damage("empty_folder", NotMetric, &[], AllRemoved),
    damage("no_folder", Error, &["depth"], NoFolder),
    damage("not_a_folder", Error, &["depth"], NotAFolder),
    // The sidecar decides how every map is read.
    damage("sidecar_is_text", Error, &[SIDECAR_NAME, "JSON", "write for instance"], Beside(SIDECAR_NAME, b"585 585")),
    damage("sidecar_cut", Error, &[SIDECAR_NAME, "JSON"], Beside(SIDECAR_NAME, br#"{"depth_camera": {"model":"#)),
    damage(
        "sidecar_nan",
        Error,
        &[SIDECAR_NAME],
        Beside(
            SIDECAR_NAME,
            br#"{"depth_camera": {"model": "PINHOLE", "width": 4, "height": 4, "params": [NaN, 1, 2, 2]}}"#,
        ),
    ),
    damage(
        "sidecar_infinite",
        Error,
        &[SIDECAR_NAME],
        Beside(
            SIDECAR_NAME,
            br#"{"depth_camera": {"model": "PINHOLE", "width": 4, "height": 4, "params": [1e999, 1, 2, 2]}}"#,
        ),
    ),
    damage(
        "sidecar_focal_zero",
        Error,
        &[SIDECAR_NAME, "depth_camera"],
        Beside(
            SIDECAR_NAME,
            br#"{"depth_camera": {"model": "PINHOLE", "width": 4, "height": 4, "params": [0, 0, 2, 2]}}"#,
        ),
    ),
    damage(
        "sidecar_rotation_of_nothing",
        Error,
        &[SIDECAR_NAME, "rotation_wxyz"],
        Beside(
            SIDECAR_NAME,
            br#"{"depth_camera": {"model": "PINHOLE", "width": 400, "height": 300, "params": [300, 300, 200, 150]},
                "color_from_depth": {"rotation_wxyz": [0, 0, 0, 0], "translation_m": [0, 0, 0]}}"#,
        ),
    ),
    // A camera a kilometre behind the scene sees none of it.
    damage(
        "sidecar_elsewhere",
        NotMetric,
        &[],
        Beside(
            SIDECAR_NAME,
            br#"{"depth_camera": {"model": "PINHOLE", "width": 400, "height": 300, "params": [300, 300, 200, 150]},
                "color_from_depth": {"rotation_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, -1000]}}"#,
        ),
    ),
];

/// One pixel of 8-bit grey, of 8-bit colour, of 16-bit grey, and a header that claims 2³⁰ × 2³⁰ pixels.
const GREY_8: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDATx\x9cch\0\0\0\x82\0\x81w\xcdr\xb6\0\0\0\0IEND\xaeB`\x82";
const RGB_8: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\x02\0\0\0\x90wS\xde\0\0\0\x0cIDATx\x9cchhh\0\0\x03\x04\x01\x81K\xd3\xd2\x10\0\0\0\0IEND\xaeB`\x82";
const GREY_16: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x10\0\0\0\0j\xeeG\x16\0\0\0\x0bIDATx\x9cc\x10`\0\0\0#\0\x111\x07\xfdw\0\0\0\0IEND\xaeB`\x82";
const HUGE: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR@\0\0\0@\0\0\0\x10\0\0\0\0-om!\0\0\0\x0bIDATx\x9cc\x10`\0\0\0#\0\x111\x07\xfdw\0\0\0\0IEND\xaeB`\x82";

/// A complex number, and nine numbers without rows.
const COMPLEX: &[u8] = &npy(*b"<c8", *b"(1, 1)");
const ONE_ROW: &[u8] = &npy(*b"<f4", *b"(9,)  ");

/// The header of an npy file that is the same length for every type and shape, and 36 bytes of data.
const fn npy(descr: [u8; 3], shape: [u8; 6]) -> [u8; 128 + 36] {
    let head = b"\x93NUMPY\x01\x00\x76\x00{'descr': '___', 'fortran_order': False, 'shape': ______, }";
    let mut bytes = [b' '; 128 + 36];
    let mut at = 0;
    while at < head.len() {
        bytes[at] = match at {
            21..24 => descr[at - 21],
            60..66 => shape[at - 60],
            _ => head[at],
        };
        at += 1;
    }
    bytes[127] = b'\n';
    bytes
}

/// Depths that no camera saw: between 0.5 m and 20 m, by nothing but their place in the list.
fn scrambled(z_m: f32, map: usize) -> f32 {
    let noise = (z_m * 7919.0 + map as f32 * 104.729).sin().abs();
    if z_m > 0.0 { 0.5 + 19.5 * noise } else { z_m }
}

impl DepthDamage {
    /// Damages a folder of maps in place.
    ///
    /// # Errors
    /// [`DepthDamageError`] when the folder holds no maps or cannot be changed.
    pub fn apply(&self, folder: &Path) -> Result<(), DepthDamageError> {
        let maps = maps_of(folder)?;
        let Some(first) = maps.first() else {
            let source = std::io::Error::new(std::io::ErrorKind::NotFound, "no depth maps");
            return Err(DepthDamageError::Io { path: folder.to_owned(), source });
        };
        let write = |path: &Path, bytes: &[u8]| fs::write(path, bytes).map_err(|e| io(path, e));
        let remove = |path: &Path| fs::remove_file(path).map_err(|e| io(path, e));
        let instead = |ending: &str| first.with_extension(ending);
        match &self.kind {
            Kind::Cut(format, share) => {
                let path = rewrite(first, *format)?;
                let bytes = fs::read(&path).map_err(|e| io(&path, e))?;
                write(&path, &bytes[..(bytes.len() as f64 * share) as usize])
            }
            Kind::Rewritten(format) => rewrite(first, *format).map(|_| ()),
            Kind::Replaced(ending, bytes) => {
                remove(first)?;
                write(&instead(ending), bytes)
            }
            Kind::Values(change) => change_values(first, change),
            Kind::AllValues(change) => {
                maps.iter().enumerate().try_for_each(|(index, map)| change_values(map, &|z| change(z, index)))
            }
            Kind::Beside(name, bytes) => write(&folder.join(name), bytes),
            Kind::Removed => remove(first),
            Kind::AllRemoved => maps.iter().try_for_each(|map| remove(map)),
            Kind::NoFolder => fs::remove_dir_all(folder).map_err(|e| io(folder, e)),
            Kind::NotAFolder => {
                fs::remove_dir_all(folder).map_err(|e| io(folder, e))?;
                write(folder, b"")
            }
        }
    }
}

fn io(path: &Path, source: std::io::Error) -> DepthDamageError {
    DepthDamageError::Io { path: path.to_owned(), source }
}

fn maps_of(folder: &Path) -> Result<Vec<PathBuf>, DepthDamageError> {
    let entries: Result<Vec<_>, _> = fs::read_dir(folder).and_then(Iterator::collect).map_err(|e| io(folder, e));
    let mut maps: Vec<PathBuf> = entries?.into_iter().map(|entry: fs::DirEntry| entry.path()).collect();
    maps.sort();
    Ok(maps)
}

/// The map in another format, in place of the old file.
fn rewrite(path: &Path, format: Format) -> Result<PathBuf, DepthDamageError> {
    let map = read_depth_map(path, None)?;
    fs::remove_file(path).map_err(|e| io(path, e))?;
    let path = path.with_extension(format.ending());
    match format {
        Png => write_depth_png(&path, &map, 0.001)?,
        Npy => write_depth_npy(&path, &map)?,
        Tiff => fs::write(&path, tiff(&map)).map_err(|e| io(&path, e))?,
        Exr => fs::write(&path, exr(&map)).map_err(|e| io(&path, e))?,
    }
    Ok(path)
}

/// The map with other values, as npy, which holds any number: written by hand, since a map in memory knows only depths.
fn change_values(path: &Path, change: &dyn Fn(f32) -> f32) -> Result<(), DepthDamageError> {
    let map = read_depth_map(path, None)?;
    let npy = rewrite(path, Npy)?;
    let bytes = fs::read(&npy).map_err(|e| io(&npy, e))?;
    let data = bytes.len() - 4 * map.values_m().len();
    let mut changed = bytes[..data].to_vec();
    // Unknown pixels take part: what claims to be a value everywhere is the harder case.
    changed.extend(map.values_m().iter().flat_map(|&z| change(z).to_le_bytes()));
    fs::write(&npy, changed).map_err(|e| io(&npy, e))
}
