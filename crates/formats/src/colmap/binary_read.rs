//! The `.bin` files of a model.

use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::{Frame, Rig, RigSensor, SensorId};
use glam::{DVec2, DVec3};

use super::raw::{Model, RawImage, RawPoint, motion};
use crate::cursor::Cursor;
use crate::error::{FormatError, Location, Problem, Warnings};

const ADVICE: &str = "copy the model again or write it anew";

/// Reads one file into the model.
pub(super) fn part(
    model: &mut Model,
    part: &str,
    bytes: &[u8],
    place: &Location,
    warnings: &mut Warnings,
) -> Result<(), FormatError> {
    let mut cursor = Cursor::new(bytes);
    match part {
        "cameras" => model.cameras = records(&mut cursor, 24, place, "camera", camera)?,
        "rigs" => model.rigs = records(&mut cursor, 8, place, "rig", rig)?,
        "frames" => model.frames = records(&mut cursor, 68, place, "frame", frame)?,
        "images" => model.images = records(&mut cursor, 73, place, "image", image)?,
        _ => model.points = records(&mut cursor, 51, place, "point", point)?,
    }
    if cursor.remaining() > 0 {
        let problem = Problem::TrailingBytes(cursor.remaining() as u64);
        warnings.push(place.clone(), problem, "they are ignored; the file may be of another program or version");
    }
    Ok(())
}

/// A count and as many records, of `least_bytes` each or more.
fn records<T>(
    cursor: &mut Cursor<'_>,
    least_bytes: usize,
    place: &Location,
    what: &str,
    mut read: impl FnMut(&mut Cursor<'_>) -> Result<T, Problem>,
) -> Result<Vec<T>, FormatError> {
    let fail = |place: Location, problem| FormatError::invalid(place, problem, ADVICE);
    let count = cursor.count(least_bytes).map_err(|problem| fail(place.clone(), problem))?;
    let mut list = Vec::with_capacity(count);
    for index in 0..count {
        let record =
            read(cursor).map_err(|problem| fail(place.clone().row(format!("{what} number {}", index + 1)), problem))?;
        list.push(record);
    }
    Ok(list)
}

fn camera(cursor: &mut Cursor<'_>) -> Result<Camera, Problem> {
    let id = cursor.u32()?;
    let model_id = cursor.i32()?;
    let (width_px, height_px) = (cursor.u64()?, cursor.u64()?);
    let model = CameraModel::from_id(model_id).ok_or_else(|| Problem::UnknownCameraModel(model_id.to_string()))?;
    let params = (0..model.num_params()).map(|_| cursor.f64()).collect::<Result<_, _>>()?;
    Ok(Camera { id, model, width_px, height_px, params, has_prior_focal: false })
}

fn sensor(cursor: &mut Cursor<'_>) -> Result<SensorId, Problem> {
    Ok(SensorId { kind: cursor.i32()?, id: cursor.u32()? })
}

fn rig(cursor: &mut Cursor<'_>) -> Result<Rig, Problem> {
    let id = cursor.u32()?;
    let count = cursor.count_u32(8)?;
    let reference = if count > 0 { Some(sensor(cursor)?) } else { None };
    let mut sensors = Vec::with_capacity(count.saturating_sub(1));
    for _ in 1..count {
        let sensor = sensor(cursor)?;
        let has_pose = cursor.u8()? != 0;
        let sensor_from_rig = if has_pose { Some(motion(cursor.f64s()?)) } else { None };
        sensors.push(RigSensor { sensor, sensor_from_rig });
    }
    Ok(Rig { id, reference, sensors })
}

fn frame(cursor: &mut Cursor<'_>) -> Result<Frame, Problem> {
    let (id, rig_id) = (cursor.u32()?, cursor.u32()?);
    let rig_from_world = motion(cursor.f64s()?);
    let count = cursor.count_u32(16)?;
    let data = (0..count).map(|_| Ok((sensor(cursor)?, cursor.u64()?))).collect::<Result<_, Problem>>()?;
    Ok(Frame { id, rig_id, rig_from_world, data })
}

fn image(cursor: &mut Cursor<'_>) -> Result<RawImage, Problem> {
    let id = cursor.u32()?;
    let cam_from_world = motion(cursor.f64s()?);
    let camera_id = cursor.u32()?;
    let name = cursor.zero_terminated()?;
    let name = std::str::from_utf8(name).map_err(|_| Problem::Syntax {
        what: "a UTF-8 name",
        found: String::from_utf8_lossy(name).chars().take(80).collect(),
    })?;
    let count = cursor.count(24)?;
    let mut keypoints_px = Vec::with_capacity(count);
    let mut point_ids = Vec::with_capacity(count);
    for _ in 0..count {
        keypoints_px.push(DVec2::new(cursor.f64()?, cursor.f64()?));
        point_ids.push(cursor.u64()?);
    }
    Ok(RawImage { id, name: name.to_owned(), camera_id, cam_from_world, keypoints_px, point_ids })
}

fn point(cursor: &mut Cursor<'_>) -> Result<RawPoint, Problem> {
    let id = cursor.u64()?;
    let position = DVec3::from_array(cursor.f64s()?);
    let rgb = [cursor.u8()?, cursor.u8()?, cursor.u8()?];
    let error_px = cursor.f64()?;
    let count = cursor.count(8)?;
    let track = (0..count).map(|_| Ok((cursor.u32()?, cursor.u32()?))).collect::<Result<_, Problem>>()?;
    Ok(RawPoint { id, position, rgb, error_px, track })
}
