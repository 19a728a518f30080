//! Ways in which a match database arrives broken, applied to a sound one.
//!
//! Each is what people really bring: interrupted copies, other programs' exports, hand-edited tables.

use std::fs;
use std::path::Path;

use rusqlite::Connection;

/// What must come of a damaged database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// A typed error; nothing is written.
    Error,
    /// A warning that names the row; the rest is reconstructed.
    Warning,
    /// Older programs wrote it so: read without complaint.
    Accepted,
}

/// One kind of damage.
pub struct Damage {
    /// A short name, fit for a file.
    pub name: &'static str,
    /// What must come of it.
    pub verdict: Verdict,
    /// A word that the message must contain: the table, or what is wrong.
    pub mentions: &'static str,
    kind: Kind,
}

enum Kind {
    /// Statements run on the database.
    Sql(&'static str),
    /// The file cut to this share of its length.
    Cut(f64),
    /// The file replaced by these bytes.
    Bytes(&'static [u8]),
    /// Bytes overwritten in the middle of the file.
    Scribble,
}

/// Why a database could not be damaged.
#[derive(Debug, thiserror::Error)]
pub enum DamageError {
    /// The statements did not run.
    #[error("damage {0}: {1}")]
    Sql(&'static str, rusqlite::Error),
    /// The file could not be changed.
    #[error("damage {0}: {1}")]
    Io(&'static str, std::io::Error),
}

const fn sql(name: &'static str, verdict: Verdict, mentions: &'static str, statements: &'static str) -> Damage {
    Damage { name, verdict, mentions, kind: Kind::Sql(statements) }
}

use Verdict::{Accepted, Error, Warning};

/// Every kind of damage.
pub const ALL: &[Damage] = &[
    // Files that are not a whole database.
    Damage { name: "empty_file", verdict: Error, mentions: "empty", kind: Kind::Bytes(b"") },
    Damage { name: "not_sqlite", verdict: Error, mentions: "not ", kind: Kind::Bytes(b"image1.jpg image2.jpg 120\n") },
    Damage { name: "cut_in_header", verdict: Error, mentions: "", kind: Kind::Cut(0.0002) },
    Damage { name: "cut_at_quarter", verdict: Error, mentions: "", kind: Kind::Cut(0.25) },
    Damage { name: "cut_at_half", verdict: Error, mentions: "", kind: Kind::Cut(0.5) },
    Damage { name: "cut_near_end", verdict: Error, mentions: "", kind: Kind::Cut(0.97) },
    Damage { name: "scribbled_over", verdict: Error, mentions: "", kind: Kind::Scribble },
    // Missing tables and columns.
    sql("no_table_cameras", Error, "cameras", "DROP TABLE cameras"),
    sql("no_table_images", Error, "images", "DROP TABLE images"),
    sql("no_table_keypoints", Error, "keypoints", "DROP TABLE keypoints"),
    sql("no_table_geometries", Error, "two_view_geometries", "DROP TABLE two_view_geometries"),
    sql("no_column_data", Error, "keypoints", "ALTER TABLE keypoints DROP COLUMN data"),
    // Nothing to reconstruct.
    sql("no_images", Error, "images", "DELETE FROM images"),
    sql("one_image", Error, "image", "DELETE FROM images WHERE image_id > 1; DELETE FROM keypoints WHERE image_id > 1"),
    sql("no_keypoints_at_all", Error, "keypoints", "DELETE FROM keypoints"),
    sql("no_edges", Error, "match", "DELETE FROM two_view_geometries; DELETE FROM matches"),
    sql("edges_without_matches", Error, "match", "UPDATE two_view_geometries SET rows = 0, data = NULL"),
    // Single bad rows.
    sql("image_without_keypoints", Warning, "3", "DELETE FROM keypoints WHERE image_id = 3"),
    sql(
        "keypoint_blob_short",
        Warning,
        "keypoints",
        "UPDATE keypoints SET data = substr(data, 1, length(data) - 5) WHERE image_id = 2",
    ),
    sql("keypoint_rows_negative", Warning, "keypoints", "UPDATE keypoints SET rows = -4 WHERE image_id = 2"),
    sql(
        "keypoint_rows_huge",
        Warning,
        "keypoints",
        "UPDATE keypoints SET rows = 9000000000000000000 WHERE image_id = 2",
    ),
    sql("keypoint_cols_odd", Warning, "keypoints", "UPDATE keypoints SET cols = 3 WHERE image_id = 2"),
    sql("keypoint_text", Warning, "keypoints", "UPDATE keypoints SET data = 'many corners' WHERE image_id = 2"),
    sql("keypoint_null", Warning, "keypoints", "UPDATE keypoints SET data = NULL WHERE image_id = 2"),
    // 0x7fc00000 is NaN and 0x7f800000 infinity, little-endian; the substr leaves the other keypoints alone.
    sql(
        "keypoint_nan",
        Warning,
        "keypoints",
        "UPDATE keypoints SET data = CAST(x'0000c07f0000c07f' || substr(data, 9) AS BLOB) WHERE image_id = 2",
    ),
    sql(
        "keypoint_infinite",
        Warning,
        "keypoints",
        "UPDATE keypoints SET data = CAST(substr(data, 1, 8) || x'0000807f0000807f' || substr(data, 17) AS BLOB)
         WHERE image_id = 2",
    ),
    sql(
        "match_blob_short",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET data = substr(data, 1, length(data) - 3)
         WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "match_index_out_of_range",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET data = CAST(x'ffffff7f00000000' || substr(data, 9) AS BLOB)
         WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "match_rows_negative",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET rows = -1 WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "match_text",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET data = 'none' WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "pair_of_unknown_image",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET pair_id = 2147483647 * 1 + 99999
         WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "pair_id_negative",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET pair_id = -5
         WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "pair_config_unknown",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET config = 77 WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "pose_nan",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET qvec = x'000000000000f87f000000000000f87f000000000000f87f000000000000f87f'
         WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "essential_blob_short",
        Warning,
        "two_view_geometries",
        "UPDATE two_view_geometries SET E = x'0011' WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql(
        "pose_zero_quaternion",
        Accepted,
        "",
        "UPDATE two_view_geometries SET qvec = zeroblob(32), tvec = zeroblob(24)
         WHERE pair_id = (SELECT min(pair_id) FROM two_view_geometries)",
    ),
    sql("image_of_missing_camera", Warning, "images", "UPDATE images SET camera_id = 999 WHERE image_id = 2"),
    sql(
        "names_twice",
        Warning,
        "00000.jpg",
        "CREATE TABLE copy (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);
         INSERT INTO copy SELECT image_id, name, camera_id FROM images; DROP TABLE images;
         ALTER TABLE copy RENAME TO images;
         UPDATE images SET name = (SELECT name FROM images WHERE image_id = 1) WHERE image_id = 2",
    ),
    // A bad camera takes its three images with it.
    sql("focal_zero", Warning, "cameras", "UPDATE cameras SET params = zeroblob(length(params)) WHERE camera_id = 2"),
    sql("focal_zero_everywhere", Error, "cameras", "UPDATE cameras SET params = zeroblob(length(params))"),
    sql(
        "focal_nan",
        Warning,
        "cameras",
        "UPDATE cameras SET params = CAST(x'000000000000f87f' || substr(params, 9) AS BLOB) WHERE camera_id = 2",
    ),
    sql("camera_params_short", Warning, "cameras", "UPDATE cameras SET params = x'00' WHERE camera_id = 2"),
    sql("camera_model_unknown", Warning, "cameras", "UPDATE cameras SET model = 4711 WHERE camera_id = 2"),
    sql("camera_size_zero", Warning, "cameras", "UPDATE cameras SET width = 0, height = -3 WHERE camera_id = 2"),
    sql("no_cameras", Error, "camera", "DELETE FROM cameras"),
];

impl Damage {
    /// Damages the database in place.
    ///
    /// # Errors
    /// [`DamageError`] when the file is not a database that the synthesiser wrote.
    pub fn apply(&self, database: &Path) -> Result<(), DamageError> {
        let io = |e| DamageError::Io(self.name, e);
        match self.kind {
            Kind::Bytes(bytes) => fs::write(database, bytes).map_err(io),
            Kind::Cut(share) => {
                let bytes = fs::read(database).map_err(io)?;
                let length = (bytes.len() as f64 * share) as usize;
                fs::write(database, &bytes[..length]).map_err(io)
            }
            Kind::Scribble => {
                let mut bytes = fs::read(database).map_err(io)?;
                // Every page but the first loses its header, as on a disk that lost its cache.
                for (i, byte) in bytes.iter_mut().enumerate().skip(4096) {
                    if i % 4096 < 64 {
                        *byte = 0xA5;
                    }
                }
                fs::write(database, bytes).map_err(io)
            }
            Kind::Sql(statements) => {
                let run = || {
                    let connection = Connection::open(database)?;
                    connection.execute_batch("PRAGMA foreign_keys = OFF; PRAGMA ignore_check_constraints = ON")?;
                    connection.execute_batch(statements)
                };
                run().map_err(|e| DamageError::Sql(self.name, e))
            }
        }
    }
}
