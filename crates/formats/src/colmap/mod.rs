//! COLMAP models: a folder of cameras, images, points, rigs and frames, binary or text (source: `algorithms.md` §3.3,
//! §3.4).
//!
//! Reading and writing changes no bit: binary → text → binary gives the same bytes.

mod assemble;
mod binary_read;
mod binary_write;
mod raw;
mod rigs;
mod text_read;
mod text_write;

use std::fs;
use std::path::Path;

use epipole_scene::Reconstruction;

use crate::atomic::{replace_files, temporary_folder};
use crate::error::{FormatError, FormatWarning, Loaded, Location, Problem, Warnings};
use raw::Model;

/// The two ways to store a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelFormat {
    /// `.bin`
    Binary,
    /// `.txt`
    Text,
}

/// The files of a model, without extension; the first three are always there, the others since COLMAP 3.12.
const PARTS: [&str; 5] = ["cameras", "images", "points3D", "rigs", "frames"];
/// All names a model may use.
const ALL_FILES: [&str; 10] = [
    "cameras.bin",
    "images.bin",
    "points3D.bin",
    "rigs.bin",
    "frames.bin",
    "cameras.txt",
    "images.txt",
    "points3D.txt",
    "rigs.txt",
    "frames.txt",
];

impl ModelFormat {
    fn extension(self) -> &'static str {
        match self {
            Self::Binary => "bin",
            Self::Text => "txt",
        }
    }

    fn file(self, part: &str) -> String {
        format!("{part}.{}", self.extension())
    }
}

/// Which format the folder's model has; binary where it has both, as COLMAP decides. `None`: the folder holds no model.
pub fn find_model_format(folder: &Path) -> Option<ModelFormat> {
    let complete = |format: ModelFormat| PARTS[..3].iter().all(|part| folder.join(format.file(part)).is_file());
    [ModelFormat::Binary, ModelFormat::Text].into_iter().find(|&format| complete(format))
}

/// Reads a model. Poses come from the frames where there are any, as COLMAP reads them; references between images and
/// points that contradict each other are dropped with a warning.
///
/// # Errors
/// Missing or truncated files, lines or records that cannot be understood, unknown camera models, repeated ids.
pub fn read_model(folder: &Path) -> Result<Loaded<Reconstruction>, FormatError> {
    let Some(format) = find_model_format(folder) else {
        let problem = if folder.is_dir() {
            let has =
                |part| [ModelFormat::Binary, ModelFormat::Text].iter().any(|f| folder.join(f.file(part)).is_file());
            let missing = PARTS[..3].iter().find(|part| !has(part)).unwrap_or(&PARTS[0]);
            Problem::MissingFile(format!("{missing}.bin (or {missing}.txt)"))
        } else {
            Problem::WrongKind { expected: "a COLMAP model", reason: "it is not a folder".into() }
        };
        let advice = "give the folder that holds cameras, images and points3D, all .bin or all .txt (often sparse/0)";
        return Err(FormatError::invalid(Location::file(folder), problem, advice));
    };
    parse_model(folder, format, |name| {
        let path = folder.join(name);
        match fs::read(&path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(FormatError::io(&path, e)),
        }
    })
}

/// As [`read_model`], from files in memory: their names without folder, and their bytes. `place` stands in messages.
///
/// # Errors
/// As [`read_model`].
pub fn read_model_files(place: &Path, files: &[(String, Vec<u8>)]) -> Result<Loaded<Reconstruction>, FormatError> {
    let bytes = |name: &str| files.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, bytes)| bytes.clone());
    let complete = |format: ModelFormat| PARTS[..3].iter().find(|part| bytes(&format.file(part)).is_none());
    match [ModelFormat::Binary, ModelFormat::Text].into_iter().find(|&format| complete(format).is_none()) {
        Some(format) => parse_model(place, format, |name| Ok(bytes(name))),
        None => {
            let binary = files.iter().any(|(name, _)| name.to_ascii_lowercase().ends_with(".bin"));
            let format = if binary { ModelFormat::Binary } else { ModelFormat::Text };
            let missing = format.file(complete(format).unwrap_or(&PARTS[0]));
            let advice = "a model is cameras, images and points3D together, all .bin or all .txt";
            Err(FormatError::invalid(Location::file(place), Problem::MissingFile(missing), advice))
        }
    }
}

fn parse_model(
    folder: &Path,
    format: ModelFormat,
    read: impl Fn(&str) -> Result<Option<Vec<u8>>, FormatError>,
) -> Result<Loaded<Reconstruction>, FormatError> {
    let mut warnings = Warnings::default();
    let mut model = Model::default();
    for part in PARTS {
        let Some(bytes) = read(&format.file(part))? else { continue };
        let place = Location::file(&folder.join(format.file(part)));
        match format {
            ModelFormat::Binary => binary_read::part(&mut model, part, &bytes, &place, &mut warnings)?,
            ModelFormat::Text => text_read::part(&mut model, part, &bytes, &place)?,
        }
    }
    let value = assemble::assemble(model, folder, format, &mut warnings)?;
    Ok(Loaded { value, warnings: warnings.finish() })
}

/// Writes a binary model into `folder` and removes any model that was there; other files stay. Where the reconstruction
/// has no rigs and frames, one rig per camera and one frame per image are written, as COLMAP 3.12 and later need them.
///
/// # Errors
/// Names that cannot be stored, indices that refer to nothing, and whatever the file system refuses; the folder is then
/// as it was.
pub fn write_model_binary(folder: &Path, reconstruction: &Reconstruction) -> Result<(), FormatError> {
    write_model(folder, reconstruction, ModelFormat::Binary)
}

/// As [`write_model_binary`], in text. Returns a warning for every image name with spaces: COLMAP's own reader cuts
/// those (this crate's does not).
///
/// # Errors
/// As [`write_model_binary`], and names that begin or end with a space.
pub fn write_model_text(folder: &Path, reconstruction: &Reconstruction) -> Result<Vec<FormatWarning>, FormatError> {
    let mut warnings = Warnings::default();
    let place = Location::file(&folder.join("images.txt"));
    for image in reconstruction.images.iter().filter(|i| i.name.contains(char::is_whitespace)) {
        let row = place.clone().row(format!("image {}", image.id));
        let problem = Problem::Syntax { what: "a name without spaces", found: image.name.clone() };
        if image.name.trim() != image.name || image.name.contains(['\n', '\r']) {
            return Err(FormatError::invalid(row, problem, "write a binary model or rename the image"));
        }
        warnings.push(row, problem, "COLMAP cuts such names when it reads text; write a binary model for it");
    }
    write_model(folder, reconstruction, ModelFormat::Text)?;
    Ok(warnings.finish())
}

/// Removes the files of a model from `folder`, and the folder itself if nothing else is in it.
///
/// # Errors
/// Whatever the file system refuses.
pub fn remove_model(folder: &Path) -> Result<(), FormatError> {
    for name in ALL_FILES {
        let path = folder.join(name);
        match fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(FormatError::io(&path, e)),
            _ => {}
        }
    }
    // Fails where something else is in it: then it is to stay.
    let _ = fs::remove_dir(folder);
    Ok(())
}

/// The files of a model in memory: names and bytes, as [`write_model_binary`] and [`write_model_text`] write them.
///
/// # Errors
/// Names that cannot be stored and indices that refer to nothing.
pub fn model_files(
    reconstruction: &Reconstruction,
    format: ModelFormat,
) -> Result<Vec<(String, Vec<u8>)>, FormatError> {
    let model = raw::View::new(Path::new("the model"), reconstruction)?;
    Ok(PARTS.map(|part| (format.file(part), encode(&model, part, format))).into())
}

fn encode(model: &raw::View<'_>, part: &str, format: ModelFormat) -> Vec<u8> {
    match format {
        ModelFormat::Binary => binary_write::part(model, part),
        ModelFormat::Text => text_write::part(model, part),
    }
}

fn write_model(folder: &Path, reconstruction: &Reconstruction, format: ModelFormat) -> Result<(), FormatError> {
    let model = raw::View::new(folder, reconstruction)?;
    if let Some(parent) = folder.parent() {
        fs::create_dir_all(parent).map_err(|e| FormatError::io(parent, e))?;
    }
    let staged = temporary_folder(folder)?;
    let names = PARTS.map(|part| format.file(part));
    for (part, name) in PARTS.into_iter().zip(&names) {
        let path = staged.path().join(name);
        fs::write(&path, encode(&model, part, format)).map_err(|e| FormatError::io(&folder.join(name), e))?;
    }
    replace_files(staged, folder, &ALL_FILES, &names.each_ref().map(String::as_str))
}

#[cfg(test)]
mod tests;
