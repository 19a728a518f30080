//! A database as COLMAP 4.2 would have written it, from a view graph: for synthetic scenes and tests.

use std::path::Path;

use epipole_scene::ViewGraph;
use glam::DVec2;
use rusqlite::{Connection, Transaction, params};

use super::MAX_NUM_IMAGES;
use super::blob::{camera_bytes, f64_bytes, matrix_bytes};
use super::open::sqlite_error;
use crate::atomic::temporary_file;
use crate::error::{FormatError, Location, Problem};

/// `major·10⁶ + minor·10⁴ + patch·10² + revision` of COLMAP 4.2.1.
const USER_VERSION: i64 = 4_020_100;

/// COLMAP 4.2's tables (source: `algorithms.md` §3.2).
const SCHEMA: &str = "
CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, ref_sensor_id INTEGER NOT NULL,
    ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX rig_ref_sensor_assignment ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE rig_sensors (rig_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL, sensor_type INTEGER NOT NULL,
    sensor_from_rig BLOB, FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX rig_sensor_assignment ON rig_sensors(sensor_id, sensor_type);
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, rig_id INTEGER NOT NULL,
    FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL,
    sensor_type INTEGER NOT NULL, FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX frame_sensor_assignment ON frame_data(data_id, sensor_type);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL, CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE pose_priors (pose_prior_id INTEGER PRIMARY KEY NOT NULL, corr_data_id INTEGER NOT NULL,
    corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER NOT NULL, position BLOB, position_covariance BLOB,
    gravity BLOB, coordinate_system INTEGER NOT NULL);
CREATE UNIQUE INDEX pose_prior_data_assignment ON pose_priors(corr_data_id, corr_sensor_id, corr_sensor_type);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL,
    data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, type INTEGER NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB, FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB,
    camera1 BLOB, camera2 BLOB);
";

/// Writes a view graph as a database of COLMAP 4.2's schema: one rig per camera, one frame per image, keypoints of two
/// columns in `f32`. Raw matches are the pair's `matches`, or its inliers where they were not read.
///
/// # Errors
/// Ids and indices that a database cannot hold, and whatever the file system refuses. The file appears complete or not
/// at all; one that exists is replaced.
pub fn write_database(path: &Path, graph: &ViewGraph) -> Result<(), FormatError> {
    check(path, graph)?;
    let file = temporary_file(path)?;
    let fail = |e: rusqlite::Error| sqlite_error(Location::file(path), &e);
    let mut connection = Connection::open(file.path()).map_err(fail)?;
    fill(&mut connection, graph).map_err(fail)?;
    connection.close().map_err(|(_, e)| fail(e))?;
    file.persist(path).map_err(|e| FormatError::io(path, e.error))?;
    Ok(())
}

fn check(path: &Path, graph: &ViewGraph) -> Result<(), FormatError> {
    let invalid = |table, problem| {
        FormatError::invalid(Location::table(path, table), problem, "the view graph cannot be written as a database")
    };
    for image in &graph.images {
        if u64::from(image.id) >= MAX_NUM_IMAGES {
            let expected = format!("below {MAX_NUM_IMAGES}");
            let problem = Problem::OutOfRange { what: "image id".into(), found: image.id.to_string(), expected };
            return Err(invalid("images", problem));
        }
        if image.camera >= graph.cameras.len() {
            let problem = Problem::Dangling { what: "camera with index", id: image.camera.to_string() };
            return Err(invalid("images", problem));
        }
    }
    for pair in &graph.pairs {
        if let Some(index) = [pair.image1, pair.image2].into_iter().find(|&i| i >= graph.images.len()) {
            let problem = Problem::Dangling { what: "image with index", id: index.to_string() };
            return Err(invalid("two_view_geometries", problem));
        }
        if graph.images[pair.image1].id >= graph.images[pair.image2].id {
            let problem = Problem::Inconsistent("the images of a pair are not in the order of their ids".into());
            return Err(invalid("two_view_geometries", problem));
        }
    }
    Ok(())
}

fn fill(connection: &mut Connection, graph: &ViewGraph) -> rusqlite::Result<()> {
    // The file is nobody's until it is complete: no journal is needed, and no sidecar may be left behind.
    connection.pragma_update(None, "journal_mode", "OFF")?;
    connection.pragma_update(None, "synchronous", "OFF")?;
    connection.pragma_update(None, "user_version", USER_VERSION)?;
    connection.execute_batch(SCHEMA)?;
    let transaction = connection.transaction()?;
    for camera in &graph.cameras {
        transaction.execute(
            "INSERT INTO cameras VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
            params![
                camera.id,
                camera.model.id(),
                camera.width_px.cast_signed(),
                camera.height_px.cast_signed(),
                f64_bytes(&camera.params),
                camera.has_prior_focal
            ],
        )?;
        transaction.execute("INSERT INTO rigs VALUES (?1, ?1, 0)", [camera.id])?;
    }
    for image in &graph.images {
        let camera_id = graph.cameras[image.camera].id;
        transaction.execute("INSERT INTO images VALUES (?1, ?2, ?3)", params![image.id, image.name, camera_id])?;
        transaction.execute("INSERT INTO frames VALUES (?1, ?2)", [image.id, camera_id])?;
        transaction.execute("INSERT INTO frame_data VALUES (?1, ?1, ?2, 0)", [image.id, camera_id])?;
        transaction.execute(
            "INSERT INTO keypoints VALUES (?1, ?2, 2, ?3)",
            params![image.id, image.keypoints_px.len() as i64, keypoint_bytes(&image.keypoints_px)],
        )?;
    }
    write_pairs(&transaction, graph)?;
    transaction.commit()
}

fn write_pairs(transaction: &Transaction<'_>, graph: &ViewGraph) -> rusqlite::Result<()> {
    let mut insert_matches = transaction.prepare("INSERT INTO matches VALUES (?1, ?2, 2, ?3)")?;
    let mut insert_geometry = transaction
        .prepare("INSERT INTO two_view_geometries VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)")?;
    for pair in &graph.pairs {
        let [id1, id2] = [pair.image1, pair.image2].map(|i| u64::from(graph.images[i].id));
        let pair_id = (MAX_NUM_IMAGES * id1 + id2).cast_signed();
        let raw = pair.matches.as_ref().unwrap_or(&pair.inliers);
        insert_matches.execute(params![pair_id, raw.len() as i64, match_bytes(raw)])?;
        let pose = pair.cam2_from_cam1;
        insert_geometry.execute(params![
            pair_id,
            pair.inliers.len() as i64,
            match_bytes(&pair.inliers),
            pair.config as i32,
            pair.fundamental.as_ref().map(matrix_bytes),
            pair.essential.as_ref().map(matrix_bytes),
            pair.homography.as_ref().map(matrix_bytes),
            pose.map(|p| f64_bytes(&[p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z])),
            pose.map(|p| f64_bytes(&p.translation.to_array())),
            pair.solver_cameras[0].as_ref().map(camera_bytes),
            pair.solver_cameras[1].as_ref().map(camera_bytes),
        ])?;
    }
    Ok(())
}

fn keypoint_bytes(keypoints_px: &[DVec2]) -> Vec<u8> {
    keypoints_px.iter().flat_map(|k| k.as_vec2().to_array()).flat_map(f32::to_le_bytes).collect()
}

fn match_bytes(matches: &[[u32; 2]]) -> Vec<u8> {
    matches.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect()
}
