//! The `.txt` files of a model, written as COLMAP writes them.

use std::fmt::Write;

use epipole_scene::{NO_POINT, SensorId};

use super::raw::{View, motion_values};
use crate::number::{push_f64, push_f64s};

/// The bytes of one file.
pub(super) fn part(model: &View<'_>, part: &str) -> Vec<u8> {
    let mut out = String::new();
    let result = match part {
        "cameras" => cameras(model, &mut out),
        "rigs" => rigs(model, &mut out),
        "frames" => frames(model, &mut out),
        "images" => images(model, &mut out),
        _ => points(model, &mut out),
    };
    debug_assert!(result.is_ok(), "writing to a String cannot fail");
    out.into_bytes()
}

fn mean(sum: usize, count: usize) -> f64 {
    if count == 0 { 0.0 } else { sum as f64 / count as f64 }
}

fn cameras(model: &View<'_>, out: &mut String) -> std::fmt::Result {
    let cameras = &model.reconstruction.cameras;
    writeln!(out, "# Camera list with one line of data per camera:")?;
    writeln!(out, "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?;
    writeln!(out, "# Number of cameras: {}", cameras.len())?;
    for camera in cameras {
        write!(out, "{} {} {} {} ", camera.id, camera.model.name(), camera.width_px, camera.height_px)?;
        push_f64s(out, &camera.params);
        out.push('\n');
    }
    Ok(())
}

/// COLMAP's word for a sensor type.
fn kind(sensor: SensorId) -> &'static str {
    match sensor.kind {
        0 => "CAMERA",
        1 => "IMU",
        _ => "INVALID",
    }
}

fn rigs(model: &View<'_>, out: &mut String) -> std::fmt::Result {
    writeln!(out, "# Rig calib list with one line of data per calib:")?;
    writeln!(
        out,
        "#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])"
    )?;
    writeln!(out, "# Number of rigs: {}", model.rigs.len())?;
    for rig in model.rigs.iter() {
        let count = rig.reference.map_or(0, |_| 1 + rig.sensors.len());
        write!(out, "{} {count}", rig.id)?;
        if let Some(reference) = rig.reference {
            write!(out, " {} {}", kind(reference), reference.id)?;
            for other in &rig.sensors {
                write!(
                    out,
                    " {} {} {}",
                    kind(other.sensor),
                    other.sensor.id,
                    u8::from(other.sensor_from_rig.is_some())
                )?;
                if let Some(pose) = &other.sensor_from_rig {
                    out.push(' ');
                    push_f64s(out, &motion_values(pose));
                }
            }
        }
        out.push('\n');
    }
    Ok(())
}

fn frames(model: &View<'_>, out: &mut String) -> std::fmt::Result {
    writeln!(out, "# Frame list with one line of data per frame:")?;
    writeln!(
        out,
        "#   FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)"
    )?;
    writeln!(out, "# Number of frames: {}", model.frames.len())?;
    for frame in model.frames.iter() {
        write!(out, "{} {} ", frame.id, frame.rig_id)?;
        push_f64s(out, &motion_values(&frame.rig_from_world));
        write!(out, " {}", frame.data.len())?;
        for (sensor, data) in &frame.data {
            write!(out, " {} {} {data}", kind(*sensor), sensor.id)?;
        }
        out.push('\n');
    }
    Ok(())
}

fn images(model: &View<'_>, out: &mut String) -> std::fmt::Result {
    let reconstruction = model.reconstruction;
    let images = &reconstruction.images;
    writeln!(out, "# Image list with two lines of data per image:")?;
    writeln!(out, "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME")?;
    writeln!(out, "#   POINTS2D[] as (X, Y, POINT3D_ID)")?;
    let observations = mean(reconstruction.num_observations(), images.len());
    writeln!(out, "# Number of images: {}, mean observations per image: {observations}", images.len())?;
    for (image, point_ids) in images.iter().zip(&model.point_ids) {
        write!(out, "{} ", image.id)?;
        push_f64s(out, &motion_values(&image.cam_from_world));
        writeln!(out, " {} {}", reconstruction.cameras[image.camera].id, image.name)?;
        for (index, (keypoint, &id)) in image.keypoints_px.iter().zip(point_ids).enumerate() {
            if index > 0 {
                out.push(' ');
            }
            push_f64s(out, &keypoint.to_array());
            if id == NO_POINT {
                out.push_str(" -1");
            } else {
                write!(out, " {id}")?;
            }
        }
        out.push('\n');
    }
    Ok(())
}

fn points(model: &View<'_>, out: &mut String) -> std::fmt::Result {
    let points = &model.reconstruction.points;
    writeln!(out, "# 3D point list with one line of data per point:")?;
    writeln!(out, "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)")?;
    let length = mean(model.reconstruction.num_observations(), points.len());
    writeln!(out, "# Number of points: {}, mean track length: {length}", points.len())?;
    for point in points {
        write!(out, "{} ", point.id)?;
        push_f64s(out, &point.position.to_array());
        let [r, g, b] = point.rgb;
        write!(out, " {r} {g} {b} ")?;
        push_f64(out, point.error_px);
        for (image_id, keypoint) in model.track(point) {
            write!(out, " {image_id} {keypoint}")?;
        }
        out.push('\n');
    }
    Ok(())
}
