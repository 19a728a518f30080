//! The `images` and `keypoints` tables.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use epipole_geometry::camera::Camera;
use epipole_scene::ViewImage;
use glam::DVec2;
use rusqlite::Row;

use super::MAX_NUM_IMAGES;
use super::blob::check_length;
use super::open::Source;
use super::schema::{Table, blob, integer, text};
use crate::error::{FormatError, Location, Problem, Warnings};

/// What is known of each image's keypoints besides their positions; parallel to the images.
pub(super) struct Keypoints {
    /// Images whose keypoints could not be read: their matches refer to nothing.
    pub(super) unusable: Vec<bool>,
    /// Per image, whether any keypoint is NaN or infinite.
    pub(super) has_non_finite: Vec<bool>,
}

/// Reads all images, sorted by id, still without keypoints.
pub(super) fn read(
    source: &Source,
    cameras: &[Camera],
    warnings: &mut Warnings,
) -> Result<Vec<ViewImage>, FormatError> {
    let table = Table::require(source, "images", "this is not a COLMAP database; give the database.db of a project")?;
    let mut rows: Vec<ViewImage> = Vec::new();
    table.for_each(source, &["image_id", "name", "camera_id"], &[], |row| {
        match image(row, cameras) {
            Ok((image, is_utf8)) => {
                if !is_utf8 {
                    let problem = Problem::Inconsistent("the name is not UTF-8".into());
                    let consequence = "its odd bytes are replaced; rename the file and import it again";
                    warnings.push(location(&table, source, image.id), problem, consequence);
                }
                rows.push(image);
            }
            Err(problem) => {
                let id = integer(row, 0, "image_id").map_or("image ?".into(), |id| format!("image {id}"));
                let consequence = "the image is left out; correct the row or import the image again";
                warnings.push(table.location(source).row(id), problem, consequence);
            }
        }
        Ok(())
    })?;
    rows.sort_by_key(|i| i.id);
    let (mut ids, mut names) = (HashSet::new(), HashSet::new());
    rows.retain(|image| {
        let (what, key) = if !ids.insert(image.id) {
            ("image id", image.id.to_string())
        } else if !names.insert(image.name.clone()) {
            ("image name", image.name.clone())
        } else {
            return true;
        };
        let consequence = "only the first is used; delete or rename the other";
        warnings.push(location(&table, source, image.id), Problem::Duplicate { what, key }, consequence);
        false
    });
    Ok(rows)
}

fn location(table: &Table, source: &Source, id: u32) -> Location {
    table.location(source).row(format!("image {id}"))
}

/// An image, and whether its name was valid UTF-8.
fn image(row: &Row<'_>, cameras: &[Camera]) -> Result<(ViewImage, bool), Problem> {
    let id = integer(row, 0, "image_id")?;
    let id = u32::try_from(id).ok().filter(|&id| u64::from(id) < MAX_NUM_IMAGES).ok_or_else(|| {
        let expected = format!("0 to {}", MAX_NUM_IMAGES - 1);
        Problem::OutOfRange { what: "image_id".into(), found: id.to_string(), expected }
    })?;
    let bytes = text(row, 1, "name")?;
    let name = String::from_utf8_lossy(bytes);
    if name.is_empty() || name.contains(['\0', '\n', '\r']) {
        return Err(Problem::Syntax { what: "a file name", found: name.escape_debug().take(80).collect() });
    }
    let camera_id = integer(row, 2, "camera_id")?;
    let camera = cameras.binary_search_by_key(&camera_id, |c| i64::from(c.id));
    let camera = camera.map_err(|_| Problem::Dangling { what: "camera", id: camera_id.to_string() })?;
    let is_utf8 = std::str::from_utf8(bytes).is_ok();
    Ok((ViewImage { id, name: name.into_owned(), camera, keypoints_px: Arc::from([]), depths: None }, is_utf8))
}

/// Reads the keypoints into the images.
pub(super) fn read_keypoints(
    source: &Source,
    images: &mut [ViewImage],
    warnings: &mut Warnings,
) -> Result<Keypoints, FormatError> {
    let advice = "extract features first (`colmap feature_extractor`)";
    let table = Table::require(source, "keypoints", advice)?;
    let index_of: HashMap<i64, usize> = images.iter().enumerate().map(|(i, image)| (i64::from(image.id), i)).collect();
    let mut seen = vec![false; images.len()];
    let mut keypoints = Keypoints { unusable: vec![false; images.len()], has_non_finite: vec![false; images.len()] };
    table.for_each(source, &["image_id", "rows", "cols", "data"], &[], |row| {
        // Keypoints of an image that is not there (dropped above, or deleted) matter to nobody.
        let Some(&index) = integer(row, 0, "image_id").ok().and_then(|id| index_of.get(&id)) else { return Ok(()) };
        let place = location(&table, source, images[index].id);
        if std::mem::replace(&mut seen[index], true) {
            let problem = Problem::Duplicate { what: "keypoints of image", key: images[index].id.to_string() };
            warnings.push(place, problem, "the first row is used");
            return Ok(());
        }
        match positions(row) {
            Ok(positions) => {
                let bad = positions.iter().filter(|p| !p.is_finite()).count();
                if bad > 0 {
                    keypoints.has_non_finite[index] = true;
                    let problem = Problem::NotFinite(format!("{bad} of {} keypoints", positions.len()));
                    warnings.push(place, problem, "their matches are left out; extract the features again");
                }
                images[index].keypoints_px = positions.into();
            }
            Err(problem) => {
                keypoints.unusable[index] = true;
                let consequence =
                    "the image stays without keypoints and its matches are left out; extract its features again";
                warnings.push(place, problem, consequence);
            }
        }
        Ok(())
    })?;
    if images.iter().all(|i| i.keypoints_px.is_empty()) {
        let problem = warnings.first().map_or(Problem::Nothing("keypoints"), |w| w.problem.clone());
        let place = warnings.first().map_or_else(|| table.location(source), |w| w.location.clone());
        return Err(FormatError::invalid(place, problem, format!("no image has keypoints; {advice}")));
    }
    for (index, image) in images.iter().enumerate() {
        if image.keypoints_px.is_empty() && !keypoints.unusable[index] {
            let consequence = "it cannot be reconstructed; extract and match its features";
            warnings.push(location(&table, source, image.id), Problem::Nothing("keypoints"), consequence);
        }
    }
    Ok(keypoints)
}

/// The positions (columns 0 and 1) of `rows × cols` `f32`, row-major; further columns are scale, orientation or shape.
fn positions(row: &Row<'_>) -> Result<Vec<DVec2>, Problem> {
    let (rows, cols) = (integer(row, 1, "rows")?, integer(row, 2, "cols")?);
    let out_of_range = |what: &str, found: i64, expected: &str| Problem::OutOfRange {
        what: what.into(),
        found: found.to_string(),
        expected: expected.into(),
    };
    let rows = u64::try_from(rows).map_err(|_| out_of_range("rows", rows, "zero or more"))?;
    let data = blob(row, 3, "data")?.unwrap_or_default();
    if rows == 0 {
        check_length(data, "data", 0, 4)?;
        return Ok(Vec::new());
    }
    if !matches!(cols, 2 | 4 | 6) {
        return Err(out_of_range("cols", cols, "2, 4 or 6"));
    }
    check_length(data, "data", rows.saturating_mul(cols as u64), 4)?;
    let coordinate = |bytes: &[u8]| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    Ok(data.chunks_exact(4 * cols as usize).map(|k| DVec2::new(coordinate(&k[..4]), coordinate(&k[4..8]))).collect())
}
