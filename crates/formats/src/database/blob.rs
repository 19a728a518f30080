//! The binary values inside rows: matrices, poses, match lists and the cameras of the two-view solver.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use glam::{DMat3, DQuat, DVec3};

use crate::cursor::Cursor;
use crate::error::Problem;

/// Poses within this of unit length are stored as they are, so that reading changes no bit.
const UNIT_TOLERANCE: f64 = 1e-9;

/// Checks the length of a blob of `count` values of `bytes_each`.
pub(super) fn check_length(blob: &[u8], column: &'static str, count: u64, bytes_each: u64) -> Result<(), Problem> {
    let expected = u128::from(count) * u128::from(bytes_each);
    if blob.len() as u128 == expected {
        Ok(())
    } else {
        Err(Problem::BlobLength { column, expected, found: blob.len() as u64 })
    }
}

/// Any number of `f64`.
pub(super) fn f64s(blob: &[u8], column: &'static str) -> Result<Vec<f64>, Problem> {
    check_length(blob, column, blob.len().div_ceil(8) as u64, 8)?;
    Ok(blob.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect())
}

fn finite<const N: usize>(blob: &[u8], column: &'static str) -> Result<[f64; N], Problem> {
    check_length(blob, column, N as u64, 8)?;
    let values = Cursor::new(blob).f64s::<N>()?;
    if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(Problem::NotFinite(format!("`{column}`"))) }
}

/// A row-major 3 × 3 matrix; NULL, an empty blob and the zero matrix mean that it is not known.
pub(super) fn matrix(blob: Option<&[u8]>, column: &'static str) -> Result<Option<DMat3>, Problem> {
    let Some(blob) = blob.filter(|b| !b.is_empty()) else { return Ok(None) };
    let values = finite::<9>(blob, column)?;
    // glam stores columns: reading rows gives the transpose.
    let matrix = DMat3::from_cols_array(&values).transpose();
    Ok((matrix != DMat3::ZERO).then_some(matrix))
}

/// The pose of a pair. Unknown: NULL, empty blobs, a zero quaternion, or exactly the identity with no translation,
/// which COLMAP before 3.14 wrote for pairs that were never posed (and which an upgrade leaves in place).
pub(super) fn pose(qvec: Option<&[u8]>, tvec: Option<&[u8]>) -> Result<Option<Rigid3>, Problem> {
    let (Some(qvec), Some(tvec)) = (qvec.filter(|b| !b.is_empty()), tvec.filter(|b| !b.is_empty())) else {
        return Ok(None);
    };
    let [w, x, y, z] = finite::<4>(qvec, "qvec")?;
    let mut translation = DVec3::from_array(finite::<3>(tvec, "tvec")?);
    let mut rotation = DQuat::from_xyzw(x, y, z, w);
    let norm = rotation.length();
    if norm == 0.0 || (rotation == DQuat::IDENTITY && translation == DVec3::ZERO) {
        return Ok(None);
    }
    if !norm.is_normal() {
        return Err(Problem::NotFinite("the length of `qvec`".into()));
    }
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        rotation /= norm;
    }
    let length = translation.length();
    if length.is_normal() && (length - 1.0).abs() > UNIT_TOLERANCE {
        translation /= length;
    }
    Ok(Some(Rigid3 { rotation, translation }))
}

/// Pairs of `u32`, as many as `rows` says; NULL stands for none.
pub(super) fn index_pairs(blob: Option<&[u8]>, rows: u64) -> Result<Vec<[u32; 2]>, Problem> {
    let blob = blob.unwrap_or_default();
    check_length(blob, "data", rows, 8)?;
    let pairs = blob.as_chunks::<8>().0.iter();
    Ok(pairs
        .map(|b| [u32::from_le_bytes([b[0], b[1], b[2], b[3]]), u32::from_le_bytes([b[4], b[5], b[6], b[7]])])
        .collect())
}

/// The intrinsics that the two-view solver estimated (COLMAP 4.2).
pub(super) fn camera(blob: Option<&[u8]>, column: &'static str) -> Result<Option<Camera>, Problem> {
    let Some(blob) = blob.filter(|b| !b.is_empty()) else { return Ok(None) };
    let mut cursor = Cursor::new(blob);
    let id = cursor.u32()?;
    let model_id = cursor.i32()?;
    let (width_px, height_px) = (cursor.u64()?, cursor.u64()?);
    let has_prior_focal = cursor.u8()? != 0;
    let count = cursor.count(8)?;
    let params = f64s(cursor.take(count * 8)?, column)?;
    // COLMAP's mark for a camera that was not set.
    if model_id < 0 {
        return Ok(None);
    }
    let model = CameraModel::from_id(model_id).ok_or(Problem::UnknownCameraModel(model_id.to_string()))?;
    let camera = Camera { id, model, width_px, height_px, params, has_prior_focal };
    super::cameras::check(&camera)?;
    Ok(Some(camera))
}

/// The opposite of [`camera`].
pub(super) fn camera_bytes(camera: &Camera) -> Vec<u8> {
    let mut out = Vec::with_capacity(33 + 8 * camera.params.len());
    out.extend(camera.id.to_le_bytes());
    out.extend(camera.model.id().to_le_bytes());
    out.extend(camera.width_px.to_le_bytes());
    out.extend(camera.height_px.to_le_bytes());
    out.push(u8::from(camera.has_prior_focal));
    out.extend((camera.params.len() as u64).to_le_bytes());
    out.extend(f64_bytes(&camera.params));
    out
}

/// `f64`s as bytes.
pub(super) fn f64_bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// The opposite of [`matrix`].
pub(super) fn matrix_bytes(matrix: &DMat3) -> Vec<u8> {
    f64_bytes(&matrix.transpose().to_cols_array())
}
