//! The `cameras` table.

use epipole_geometry::camera::{Camera, CameraModel};
use rusqlite::Row;

use super::blob;
use super::open::Source;
use super::schema::{Table, blob as blob_of, integer, optional_integer};
use crate::error::{FormatError, Problem, Warnings};

const DROPPED: &str = "the camera and its images are left out; correct the row or import the images again";

/// Reads all cameras, sorted by id; cameras that cannot be used are dropped with a warning.
pub(super) fn read(source: &Source, warnings: &mut Warnings) -> Result<Vec<Camera>, FormatError> {
    let table = Table::require(source, "cameras", "this is not a COLMAP database; give the database.db of a project")?;
    let mut cameras: Vec<Camera> = Vec::new();
    let columns = ["camera_id", "model", "width", "height", "params"];
    table.for_each(source, &columns, &["prior_focal_length"], |row| {
        match camera(row) {
            Ok(camera) => cameras.push(camera),
            Err(problem) => {
                let name = integer(row, 0, "camera_id").map_or("camera ?".into(), |id| format!("camera {id}"));
                warnings.push(table.location(source).row(name), problem, DROPPED);
            }
        }
        Ok(())
    })?;
    // A stable sort: of two rows with one id, the first stays.
    cameras.sort_by_key(|c| c.id);
    cameras.dedup_by(|later, first| {
        let same = later.id == first.id;
        if same {
            let problem = Problem::Duplicate { what: "camera", key: later.id.to_string() };
            warnings.push(table.location(source), problem, "the first row is used");
        }
        same
    });
    Ok(cameras)
}

fn camera(row: &Row<'_>) -> Result<Camera, Problem> {
    let id = integer(row, 0, "camera_id")?;
    let id = u32::try_from(id).map_err(|_| out_of_range("camera_id", id, "a 32-bit id"))?;
    let model_id = integer(row, 1, "model")?;
    let unknown = || Problem::UnknownCameraModel(format!("{model_id} (known are 0 to 17)"));
    let model = i32::try_from(model_id).ok().and_then(CameraModel::from_id).ok_or_else(unknown)?;
    let size = |index, column| {
        let value = integer(row, index, column)?;
        u64::try_from(value).map_err(|_| out_of_range(column, value, "a positive number of pixels"))
    };
    let params = blob::f64s(blob_of(row, 4, "params")?.unwrap_or_default(), "params")?;
    let has_prior_focal = optional_integer(row, 5, "prior_focal_length")?.unwrap_or(0) != 0;
    let camera =
        Camera { id, model, width_px: size(2, "width")?, height_px: size(3, "height")?, params, has_prior_focal };
    check(&camera)?;
    Ok(camera)
}

fn out_of_range(what: &str, found: impl ToString, expected: &str) -> Problem {
    Problem::OutOfRange { what: what.into(), found: found.to_string(), expected: expected.into() }
}

/// Whether a camera can form images: the right number of finite parameters, a size, a positive focal length.
pub(crate) fn check(camera: &Camera) -> Result<(), Problem> {
    let expected = camera.model.num_params();
    if camera.params.len() != expected {
        let (column, expected, found) = ("params", expected as u128 * 8, camera.params.len() as u64 * 8);
        return Err(Problem::BlobLength { column, expected, found });
    }
    if camera.width_px == 0 || camera.height_px == 0 {
        let size = format!("{} x {}", camera.width_px, camera.height_px);
        return Err(out_of_range("the image size", size, "at least 1 x 1"));
    }
    if let Some(bad) = camera.params.iter().position(|p| !p.is_finite()) {
        return Err(Problem::NotFinite(format!("parameter {bad} of {}", camera.model.name())));
    }
    for &index in camera.model.focal_params() {
        if camera.params[index] <= 0.0 {
            return Err(out_of_range("the focal length", camera.params[index], "a positive number of pixels"));
        }
    }
    Ok(())
}
