//! The `.bin` files of a model, written.

use epipole_geometry::Rigid3;
use epipole_scene::SensorId;

use super::raw::{View, motion_values};
use crate::number::canonical_bytes;

/// The bytes of one file.
pub(super) fn part(model: &View<'_>, part: &str) -> Vec<u8> {
    let mut out = Vec::new();
    match part {
        "cameras" => cameras(model, &mut out),
        "rigs" => rigs(model, &mut out),
        "frames" => frames(model, &mut out),
        "images" => images(model, &mut out),
        _ => points(model, &mut out),
    }
    out
}

fn count(out: &mut Vec<u8>, count: usize) {
    out.extend((count as u64).to_le_bytes());
}

fn numbers(out: &mut Vec<u8>, values: &[f64]) {
    out.extend(values.iter().flat_map(|&v| canonical_bytes(v)));
}

fn motion(out: &mut Vec<u8>, pose: &Rigid3) {
    numbers(out, &motion_values(pose));
}

fn sensor(out: &mut Vec<u8>, sensor: SensorId) {
    out.extend(sensor.kind.to_le_bytes());
    out.extend(sensor.id.to_le_bytes());
}

fn cameras(model: &View<'_>, out: &mut Vec<u8>) {
    count(out, model.reconstruction.cameras.len());
    for camera in &model.reconstruction.cameras {
        out.extend(camera.id.to_le_bytes());
        out.extend(camera.model.id().to_le_bytes());
        out.extend(camera.width_px.to_le_bytes());
        out.extend(camera.height_px.to_le_bytes());
        numbers(out, &camera.params);
    }
}

fn rigs(model: &View<'_>, out: &mut Vec<u8>) {
    count(out, model.rigs.len());
    for rig in model.rigs.iter() {
        out.extend(rig.id.to_le_bytes());
        let Some(reference) = rig.reference else {
            out.extend(0u32.to_le_bytes());
            continue;
        };
        out.extend((1 + rig.sensors.len() as u32).to_le_bytes());
        sensor(out, reference);
        for other in &rig.sensors {
            sensor(out, other.sensor);
            out.push(u8::from(other.sensor_from_rig.is_some()));
            if let Some(pose) = &other.sensor_from_rig {
                motion(out, pose);
            }
        }
    }
}

fn frames(model: &View<'_>, out: &mut Vec<u8>) {
    count(out, model.frames.len());
    for frame in model.frames.iter() {
        out.extend(frame.id.to_le_bytes());
        out.extend(frame.rig_id.to_le_bytes());
        motion(out, &frame.rig_from_world);
        out.extend((frame.data.len() as u32).to_le_bytes());
        for (source, data) in &frame.data {
            sensor(out, *source);
            out.extend(data.to_le_bytes());
        }
    }
}

fn images(model: &View<'_>, out: &mut Vec<u8>) {
    let reconstruction = model.reconstruction;
    count(out, reconstruction.images.len());
    for (image, point_ids) in reconstruction.images.iter().zip(&model.point_ids) {
        out.extend(image.id.to_le_bytes());
        motion(out, &image.cam_from_world);
        out.extend(reconstruction.cameras[image.camera].id.to_le_bytes());
        out.extend(image.name.as_bytes());
        out.push(0);
        count(out, point_ids.len());
        for (keypoint, id) in image.keypoints_px.iter().zip(point_ids) {
            numbers(out, &keypoint.to_array());
            out.extend(id.to_le_bytes());
        }
    }
}

fn points(model: &View<'_>, out: &mut Vec<u8>) {
    count(out, model.reconstruction.points.len());
    for point in &model.reconstruction.points {
        out.extend(point.id.to_le_bytes());
        numbers(out, &point.position.to_array());
        out.extend(point.rgb);
        numbers(out, &[point.error_px]);
        count(out, point.observations.len());
        for (image_id, keypoint) in model.track(point) {
            out.extend(image_id.to_le_bytes());
            out.extend(keypoint.to_le_bytes());
        }
    }
}
