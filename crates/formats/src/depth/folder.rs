//! Which file of a folder is the depth map of which image: by name, in the habits of the data sets and programs there are.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::FormatError;

/// Endings of depth maps, the preferred first where several files share a name.
const ENDINGS: [&str; 9] =
    [".npy", ".npz", ".exr", ".tiff", ".tif", ".geometric.bin", ".photometric.bin", ".png", ".bin"];

/// What an image's name may end with besides, for instance `frame-000000.color.jpg`.
const IMAGE_MARKS: [&str; 3] = ["color", "rgb", "image"];

/// What a depth map's name ends with or lies in, for instance `frame-000000.depth.png`.
const DEPTH_MARKS: [&str; 1] = ["depth"];

/// The same of confidences.
const CONFIDENCE_MARKS: [&str; 2] = ["confidence", "conf"];

/// Between a name and a mark.
const SEPARATORS: [char; 3] = ['.', '_', '-'];

/// Folders within folders that are looked into.
const MAX_DEPTH: usize = 8;

/// Where depth maps lie: a folder of the disk, or files that somebody holds in a browser tab.
pub trait DepthFiles {
    /// The whole content of a file that [`DepthNames`] knows.
    ///
    /// # Errors
    /// As [`fs::read`].
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>>;
}

/// Files of the disk.
#[derive(Debug)]
pub struct OnDisk;

impl DepthFiles for OnDisk {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        fs::read(path)
    }
}

/// The files of a folder, by name without ending, relative to the folder, with `/` between folders.
#[derive(Debug, Default)]
pub struct DepthNames {
    depths: Index,
    confidences: Index,
}

/// Files by their full name and by what is left of it without folders.
#[derive(Debug, Default)]
struct Index {
    by_path: BTreeMap<String, (usize, PathBuf)>,
    /// Full names; more than one where folders repeat names.
    by_stem: BTreeMap<String, Vec<String>>,
}

impl DepthNames {
    /// Files by their paths relative to the folder, with `/` between folders.
    pub fn of<'a>(paths: impl Iterator<Item = &'a str>) -> Self {
        let mut names = Self::default();
        for path in paths {
            let (prefix, name) = path.split_at(path.rfind('/').map_or(0, |slash| slash + 1));
            names.add(prefix, name, PathBuf::from(path));
        }
        names
    }

    /// Lists a folder and the folders in it.
    pub(super) fn open(path: &Path) -> Result<Self, FormatError> {
        let mut folder = Self::default();
        folder.list(path, "", 0)?;
        Ok(folder)
    }

    fn list(&mut self, path: &Path, prefix: &str, depth: usize) -> Result<(), FormatError> {
        let io = |e| FormatError::io(path, e);
        for entry in fs::read_dir(path).map_err(io)? {
            let entry = entry.map_err(io)?;
            let name = entry.file_name();
            // A name that is not text cannot be the name of an image of a database.
            let Some(name) = name.to_str() else { continue };
            // Follows links, as data sets are often put together from them.
            let Ok(kind) = fs::metadata(entry.path()) else { continue };
            if kind.is_dir() && depth < MAX_DEPTH {
                self.list(&entry.path(), &format!("{prefix}{name}/"), depth + 1)?;
            } else if kind.is_file() {
                self.add(prefix, name, entry.path());
            }
        }
        Ok(())
    }

    fn add(&mut self, prefix: &str, name: &str, path: PathBuf) {
        let lower = name.to_ascii_lowercase();
        let Some(rank) = ENDINGS.iter().position(|ending| lower.ends_with(ending)) else { return };
        let stem = &name[..name.len() - ENDINGS[rank].len()];
        let in_confidence_folder = prefix.split('/').any(|folder| CONFIDENCE_MARKS.contains(&folder));
        match without_mark(stem, &CONFIDENCE_MARKS) {
            Some(unmarked) => self.confidences.add(format!("{prefix}{unmarked}"), rank, path),
            None if in_confidence_folder => self.confidences.add(format!("{prefix}{stem}"), rank, path),
            None => self.depths.add(format!("{prefix}{stem}"), rank, path),
        }
    }

    /// The depth map of an image.
    pub(super) fn depth_of(&self, image: &str) -> Option<&Path> {
        self.depths.find(image, &DEPTH_MARKS)
    }

    /// The confidences of an image.
    pub(super) fn confidence_of(&self, image: &str) -> Option<&Path> {
        self.confidences.find(image, &DEPTH_MARKS)
    }
}

impl Index {
    fn add(&mut self, name: String, rank: usize, path: PathBuf) {
        let (_, stem) = name.rsplit_once('/').unwrap_or(("", &name));
        let same_stem = self.by_stem.entry(stem.to_owned()).or_default();
        if !same_stem.contains(&name) {
            same_stem.push(name.clone());
        }
        let better = self.by_path.get(&name).is_none_or(|(old, _)| rank < *old);
        if better {
            self.by_path.insert(name, (rank, path));
        }
    }

    /// Tries the image's folders and every shorter part of them, then the whole folder for a name that occurs once.
    fn find(&self, image: &str, marks: &[&str]) -> Option<&Path> {
        let (folders, base) = image.rsplit_once('/').unwrap_or(("", image));
        let names = candidates(base, marks);
        let mut rest = Some(folders);
        while let Some(folders) = rest {
            let prefix = if folders.is_empty() { String::new() } else { format!("{folders}/") };
            if let Some((_, path)) = names.iter().find_map(|name| self.by_path.get(&format!("{prefix}{name}"))) {
                return Some(path);
            }
            rest = match folders.split_once('/') {
                Some((_, shorter)) => Some(shorter),
                None if folders.is_empty() => None,
                None => Some(""),
            };
        }
        let unique = names.iter().find_map(|name| match self.by_stem.get(name)?.as_slice() {
            [only] => self.by_path.get(only),
            _ => None,
        });
        unique.map(|(_, path)| path.as_path())
    }
}

/// Names without ending that the map of an image may have, best first.
fn candidates(base: &str, marks: &[&str]) -> Vec<String> {
    let stem = base.rsplit_once('.').map_or(base, |(stem, _)| if stem.is_empty() { base } else { stem });
    let plain = without_mark(stem, &IMAGE_MARKS).unwrap_or(stem);
    let mut names = Vec::new();
    // `frame.jpg.geometric.bin` keeps the ending of the image.
    for of in [plain, stem, base] {
        for mark in marks {
            names.extend(SEPARATORS.map(|separator| format!("{of}{separator}{mark}")));
            names.extend(SEPARATORS.map(|separator| format!("{mark}{separator}{of}")));
        }
    }
    for image_mark in IMAGE_MARKS {
        for (separator, mark) in SEPARATORS.iter().flat_map(|s| marks.iter().map(move |m| (s, m))) {
            if let Some(rest) = stem.strip_prefix(image_mark).and_then(|rest| rest.strip_prefix(*separator)) {
                names.push(format!("{mark}{separator}{rest}"));
            }
        }
    }
    names.extend([stem, base, plain].map(str::to_owned));
    names
}

/// The name without a mark and the separator before it.
fn without_mark<'a>(stem: &'a str, marks: &[&str]) -> Option<&'a str> {
    let rest = marks.iter().find_map(|mark| stem.strip_suffix(mark)?.strip_suffix(SEPARATORS))?;
    (!rest.is_empty()).then_some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[&str]) -> DepthNames {
        DepthNames::of(files.iter().copied())
    }

    fn found(files: &[&str], image: &str) -> Option<String> {
        folder(files).depth_of(image).map(|path| path.display().to_string())
    }

    #[test]
    fn the_habits_of_data_sets_are_known() {
        for (file, image) in [
            ("frame-000000.depth.png", "frame-000000.color.jpg"),
            ("a/0001.png", "a/0001.jpg"),
            ("0001.png", "a/0001.jpg"),
            ("cam0/0001.npy", "images/cam0/0001.jpg"),
            ("images/npy/0001.npy", "0001.jpg"),
            ("0001_depth.npz", "0001.png"),
            ("depth_0001.png", "rgb_0001.png"),
            ("depth-0001.exr", "0001.png"),
            ("0001.jpg.geometric.bin", "0001.jpg"),
            ("dense/stereo/depth_maps/0001.jpg.photometric.bin", "0001.jpg"),
            ("0001.TIFF", "0001.JPG"),
        ] {
            assert_eq!(found(&[file, "other.png"], image).as_deref(), Some(file), "{image}");
        }
    }

    #[test]
    fn what_is_not_clear_is_not_taken() {
        assert_eq!(found(&["cam0/0001.png", "cam1/0001.png"], "0001.jpg"), None);
        assert_eq!(found(&["cam0/0001.png", "cam1/0001.png"], "cam1/0001.jpg").as_deref(), Some("cam1/0001.png"));
        assert_eq!(found(&["0001.txt", "0002.png", "0001.pose.txt"], "0001.jpg"), None);
        assert_eq!(found(&[], ""), None);
        assert_eq!(found(&["a.png"], ".."), None);
    }

    #[test]
    fn the_map_is_preferred_to_the_picture_beside_it() {
        let seven_scenes = ["frame-000000.color.png", "frame-000000.depth.png"];
        assert_eq!(found(&seven_scenes, "frame-000000.color.png").as_deref(), Some(seven_scenes[1]));
        assert_eq!(found(&["1.photometric.bin", "1.geometric.bin"], "1.jpg").as_deref(), Some("1.geometric.bin"));
    }

    #[test]
    fn confidences_are_told_from_depths() {
        let files = ["depth/1.png", "confidence/1.png", "2.npy", "2_confidence.png"];
        let folder = folder(&files);
        assert_eq!(folder.depth_of("1.jpg"), Some(Path::new("depth/1.png")));
        assert_eq!(folder.confidence_of("1.jpg"), Some(Path::new("confidence/1.png")));
        assert_eq!(folder.depth_of("2.jpg"), Some(Path::new("2.npy")));
        assert_eq!(folder.confidence_of("2.jpg"), Some(Path::new("2_confidence.png")));
        assert_eq!(folder.confidence_of("3.jpg"), None);
    }
}
