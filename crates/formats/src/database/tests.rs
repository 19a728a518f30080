//! The database reader against real files, every way a file can be wrong, and the writer.

use std::path::PathBuf;
use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::{Pair, PairConfig, ViewImage};
use glam::{DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;
use rusqlite::Connection;

use super::*;
use crate::error::FormatWarning;

fn shared(path: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(path);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: no shared data");
    None
}

/// Images, keypoints, pairs, verified matches, raw matches, poses.
fn counts(graph: &ViewGraph) -> [usize; 6] {
    [
        graph.images.len(),
        graph.images.iter().map(|i| i.keypoints_px.len()).sum(),
        graph.pairs.len(),
        graph.pairs.iter().map(|p| p.inliers.len()).sum(),
        graph.pairs.iter().map(|p| p.num_matches).sum(),
        graph.pairs.iter().filter(|p| p.cam2_from_cam1.is_some()).count(),
    ]
}

fn graph() -> ViewGraph {
    let camera = |id, model: CameraModel, params: &[f64]| Camera {
        id,
        model,
        width_px: 640,
        height_px: 480,
        params: params.to_vec(),
        has_prior_focal: id == 1,
    };
    let keypoints: Arc<[DVec2]> = (0..5).map(|i| DVec2::new(f64::from(i) + 0.5, 10.25)).collect();
    let image = |id, camera| ViewImage {
        id,
        name: format!("folder/image {id}.jpg"),
        camera,
        keypoints_px: keypoints.clone(),
        depths: None,
    };
    let pose = Rigid3::new(DQuat::from_xyzw(0.1, 0.2, -0.3, 0.9), DVec3::new(0.6, 0.0, -0.8));
    let pair = |image1, image2| Pair {
        image1,
        image2,
        config: PairConfig::Calibrated,
        fundamental: Some(DMat3::from_cols_array(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.5])),
        essential: None,
        homography: Some(DMat3::IDENTITY),
        cam2_from_cam1: Some(pose),
        solver_cameras: [None, Some(camera(9, CameraModel::SimplePinhole, &[500.0, 320.0, 240.0]))],
        inliers: vec![[0, 1], [4, 3]],
        matches: Some(vec![[0, 1], [2, 2], [4, 3]]),
        num_matches: 3,
    };
    ViewGraph {
        cameras: vec![
            camera(1, CameraModel::SimpleRadial, &[500.0, 320.0, 240.0, -0.1]),
            camera(4, CameraModel::Pinhole, &[510.0, 500.0, 320.0, 240.0]),
        ],
        images: vec![image(2, 0), image(3, 1), image(10, 0)],
        pairs: vec![pair(0, 1), pair(0, 2), pair(1, 2)],
    }
}

/// A written database, for a test to spoil.
struct Fixture {
    _dir: tempfile::TempDir,
    path: PathBuf,
}

impl Fixture {
    fn new() -> Self {
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("data base?#%41.db");
        write_database(&path, &graph()).expect("write");
        Self { _dir: dir, path }
    }

    fn spoiled(sql: &str) -> Self {
        let fixture = Self::new();
        let connection = Connection::open(&fixture.path).expect("open");
        connection.execute_batch("PRAGMA foreign_keys = OFF; PRAGMA ignore_check_constraints = ON;").expect("pragma");
        connection.execute_batch(sql).expect(sql);
        fixture
    }

    fn read(&self) -> Result<Loaded<ViewGraph>, FormatError> {
        read_database(&self.path, &ReadOptions { raw_matches: true })
    }

    fn error(&self) -> String {
        self.read().expect_err("an error").to_string()
    }

    fn loaded(&self) -> (ViewGraph, Vec<FormatWarning>) {
        let loaded = self.read().expect("readable");
        (loaded.value, loaded.warnings)
    }
}

fn assert_warns(warnings: &[FormatWarning], table: &str, words: &str) {
    let found = warnings.iter().any(|w| w.location.table.as_deref() == Some(table) && w.to_string().contains(words));
    assert!(found, "no warning of {table} with `{words}` in {warnings:#?}");
}

#[test]
fn real_databases_have_their_known_counts() {
    // Counted with SQL in these files.
    for (file, expected) in [
        ("strecha_castle-P19/database.db", [19, 114_291, 171, 50_470, 57_437, 152]),
        ("colmap2017_db/database.db", [23, 16_646, 253, 9541, 10_363, 0]),
        ("colmap2017_db/database_upgraded_4x.db", [23, 16_646, 253, 9541, 10_363, 0]),
        ("bonsai292/database.db", [292, 1_010_396, 2117, 806_069, 893_203, 1706]),
    ] {
        let Some(path) = shared(file) else { return };
        let before = std::fs::metadata(&path).and_then(|m| m.modified()).expect("time");
        for raw_matches in [false, true] {
            let loaded = read_database(&path, &ReadOptions { raw_matches }).expect(file);
            assert_eq!(counts(&loaded.value), expected, "{file}");
            assert!(loaded.warnings.is_empty(), "{file}: {:#?}", loaded.warnings);
        }
        assert_eq!(std::fs::metadata(&path).and_then(|m| m.modified()).expect("time"), before);
    }
}

#[test]
fn written_databases_read_back() {
    let fixture = Fixture::new();
    let (graph, warnings) = fixture.loaded();
    assert!(warnings.is_empty(), "{warnings:#?}");
    assert_eq!(format!("{graph:?}"), format!("{:?}", super::tests::graph()));
    let without_raw = read_database(&fixture.path, &ReadOptions::default()).expect("read").value;
    assert!(without_raw.pairs.iter().all(|p| p.matches.is_none() && p.num_matches == 3));
    let folder = fixture.path.parent().expect("parent");
    assert_eq!(std::fs::read_dir(folder).expect("list").count(), 1, "no sidecar is left");
}

#[test]
fn a_write_ahead_log_is_seen_and_left_alone() {
    let fixture = Fixture::new();
    let connection = Connection::open(&fixture.path).expect("open");
    let mode: String = connection.query_row("PRAGMA journal_mode = WAL", [], |r| r.get(0)).expect("wal");
    assert_eq!(mode, "wal");
    connection.execute("UPDATE images SET name = 'fresh.jpg' WHERE image_id = 3", []).expect("update");
    let wal = open::with_suffix(&fixture.path, "-wal");
    let before = (std::fs::read(&fixture.path).expect("db"), std::fs::read(&wal).expect("wal"));
    assert_eq!(fixture.loaded().0.images[1].name, "fresh.jpg", "while another program has it open");
    // A copy of both files, as somebody would send them: no -shm there.
    let sent = Fixture::new();
    std::fs::write(&sent.path, &before.0).expect("copy");
    std::fs::write(open::with_suffix(&sent.path, "-wal"), &before.1).expect("copy");
    assert_eq!(sent.loaded().0.images[1].name, "fresh.jpg");
    assert_eq!(std::fs::read(&sent.path).expect("db"), before.0);
    assert_eq!(std::fs::read(open::with_suffix(&sent.path, "-wal")).expect("wal"), before.1);
    assert_eq!((std::fs::read(&fixture.path).expect("db"), std::fs::read(&wal).expect("wal")), before);
}

#[test]
fn the_schema_of_2016_is_read() {
    let fixture = Fixture::spoiled(
        "CREATE TABLE inlier_matches AS SELECT pair_id, rows, cols, data, config FROM two_view_geometries;
         DROP TABLE two_view_geometries; DROP TABLE rigs; DROP TABLE rig_sensors; DROP TABLE frames;
         DROP TABLE frame_data; DROP TABLE pose_priors;
         ALTER TABLE cameras DROP COLUMN prior_focal_length; PRAGMA user_version = 0;",
    );
    let (graph, warnings) = fixture.loaded();
    assert!(warnings.is_empty(), "{warnings:#?}");
    assert_eq!(graph.pairs[2].inliers, [[0, 1], [4, 3]]);
    assert!(graph.pairs.iter().all(|p| p.cam2_from_cam1.is_none() && p.config == PairConfig::Calibrated));
    assert!(graph.cameras.iter().all(|c| !c.has_prior_focal));
}

#[test]
fn sentinels_mean_unknown() {
    let fixture = Fixture::spoiled(
        "UPDATE two_view_geometries SET F = zeroblob(72), qvec = zeroblob(32), tvec = zeroblob(24);
         UPDATE two_view_geometries SET qvec = CAST(x'000000000000f03f' || zeroblob(24) AS BLOB) WHERE pair_id % 2 = 0;
         UPDATE two_view_geometries SET rows = 0, data = NULL, H = NULL WHERE pair_id = 2 * 2147483647 + 3;",
    );
    let (graph, warnings) = fixture.loaded();
    assert!(warnings.is_empty(), "{warnings:#?}");
    assert!(graph.pairs.iter().all(|p| p.cam2_from_cam1.is_none() && p.fundamental.is_none()));
    assert!(graph.pairs[0].inliers.is_empty() && graph.pairs[0].homography.is_none());
    assert!(graph.pairs[1].homography.is_some());
}

#[test]
fn keypoints_of_four_and_six_columns() {
    for cols in [4usize, 6] {
        let rows: Vec<u8> = (0..5 * cols).flat_map(|i| (i as f32).to_le_bytes()).collect();
        let hex: String = rows.iter().map(|b| format!("{b:02x}")).collect();
        let fixture = Fixture::spoiled(&format!("UPDATE keypoints SET cols = {cols}, data = x'{hex}'"));
        let (graph, _) = fixture.loaded();
        assert_eq!(graph.images[1].keypoints_px[2], DVec2::new(2.0 * cols as f64, 2.0 * cols as f64 + 1.0));
    }
}

#[test]
fn pairs_stored_the_wrong_way_round_are_turned() {
    let fixture = Fixture::spoiled(
        "DELETE FROM matches; DELETE FROM two_view_geometries WHERE pair_id <> 2 * 2147483647 + 3;
         UPDATE two_view_geometries SET pair_id = 3 * 2147483647 + 2",
    );
    let pair = &fixture.loaded().0.pairs[0];
    let straight = &graph().pairs[0];
    assert_eq!((pair.image1, pair.image2), (0, 1));
    assert_eq!(pair.inliers, [[1, 0], [3, 4]]);
    assert_eq!(pair.fundamental, straight.fundamental.map(|f| f.transpose()));
    let round_trip = pair.cam2_from_cam1.expect("pose") * straight.cam2_from_cam1.expect("pose");
    assert!((round_trip.translation).length() < 1e-12);
    assert!(pair.solver_cameras[0].is_some() && pair.solver_cameras[1].is_none());
}

#[test]
fn files_that_are_no_database() {
    let dir = tempfile::tempdir().expect("temp dir");
    let check = |name: &str, content: &[u8], words: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, content).expect("write");
        let error = read_database(&path, &ReadOptions::default()).expect_err("refused").to_string();
        assert!(error.contains(words) && error.contains(name), "{error}");
    };
    check("text.db", b"I am not a database, am I?", "SQLite's mark");
    check("empty.db", b"", "empty");
    let whole = std::fs::read(&Fixture::new().path).expect("read");
    check("header.db", &whole[..60], "cut off");
    check("half.db", &whole[..whole.len() / 2], "cut off");
    assert!(read_database(dir.path(), &ReadOptions::default()).expect_err("folder").to_string().contains("folder"));
    let missing = read_database(&dir.path().join("none.db"), &ReadOptions::default()).expect_err("missing");
    assert!(matches!(missing, FormatError::Io { .. }), "{missing}");
}

#[test]
fn what_leaves_nothing_is_an_error() {
    for (sql, words) in [
        ("DROP TABLE cameras", "table cameras: the table is missing"),
        ("DROP TABLE images", "table images: the table is missing"),
        ("DROP TABLE keypoints", "table keypoints: the table is missing"),
        ("DROP TABLE two_view_geometries; DROP TABLE matches", "table two_view_geometries: the table is missing"),
        ("DROP TABLE images; CREATE TABLE images (image_id INTEGER, name TEXT)", "`camera_id` is missing"),
        ("DELETE FROM images", "there are no images"),
        ("DELETE FROM keypoints", "there are no keypoints"),
        ("UPDATE cameras SET model = 99", "camera 1: unknown camera model 99"),
        ("UPDATE cameras SET params = x'00'", "camera 1: `params` has 1 bytes"),
        ("UPDATE cameras SET params = zeroblob(32)", "the focal length is 0"),
        ("UPDATE cameras SET params = NULL", "`params` has 0 bytes"),
        ("UPDATE cameras SET width = 0", "image size is 0 x 480"),
        ("UPDATE cameras SET width = -5", "`width`|width is -5"),
        ("DELETE FROM cameras", "camera 1 does not exist"),
    ] {
        let error = Fixture::spoiled(sql).error();
        assert!(words.split('|').any(|w| error.contains(w)), "{sql}: {error}");
    }
}

#[test]
fn one_bad_row_is_dropped_with_a_warning() {
    let nan = "x'0000c07f0000c07f'";
    for (sql, table, words, images, pairs) in [
        ("UPDATE cameras SET params = zeroblob(32) WHERE camera_id = 4", "cameras", "focal length is 0", 2, 1),
        ("UPDATE images SET camera_id = 77 WHERE image_id = 10", "images", "camera 77 does not exist", 2, 1),
        ("DELETE FROM images WHERE image_id = 3", "two_view_geometries", "image 3 does not exist", 2, 1),
        ("UPDATE images SET name = x'00' WHERE image_id = 3", "images", "not text", 2, 1),
        ("DELETE FROM keypoints WHERE image_id = 3", "keypoints", "there are no keypoints", 3, 1),
        ("UPDATE keypoints SET data = x'0011' WHERE image_id = 3", "keypoints", "2 bytes, not 40", 3, 1),
        ("UPDATE keypoints SET cols = 3 WHERE image_id = 3", "keypoints", "cols is 3", 3, 1),
        ("UPDATE keypoints SET rows = 9000000000000000000 WHERE image_id = 3", "keypoints", "bytes, not", 3, 1),
        ("UPDATE keypoints SET rows = -1 WHERE image_id = 3", "keypoints", "rows is -1", 3, 1),
        (
            "UPDATE two_view_geometries SET config = 12 WHERE pair_id % 2147483647 = 3",
            "two_view_geometries",
            "config is 12",
            3,
            3,
        ),
        (
            "UPDATE two_view_geometries SET data = x'01' WHERE pair_id % 2147483647 = 3",
            "two_view_geometries",
            "`data` has 1 bytes",
            3,
            3,
        ),
        (
            "UPDATE two_view_geometries SET data = x'0000000005000000', rows = 1 WHERE pair_id % 2147483647 = 3",
            "two_view_geometries",
            "match index of image 3 is 5",
            3,
            3,
        ),
        (
            "UPDATE two_view_geometries SET pair_id = -7 WHERE pair_id % 2147483647 = 3",
            "two_view_geometries",
            "pair_id is -7",
            3,
            3,
        ),
        (
            "UPDATE two_view_geometries SET rows = 'many' WHERE pair_id % 2147483647 = 3",
            "two_view_geometries",
            "rows",
            3,
            3,
        ),
        ("UPDATE two_view_geometries SET E = x'0102'", "two_view_geometries", "`E` has 2 bytes", 3, 3),
        ("UPDATE two_view_geometries SET camera1 = x'0102'", "two_view_geometries", "cut off", 3, 3),
        ("UPDATE matches SET data = NULL", "matches", "`data` has 0 bytes", 3, 3),
        ("DROP TABLE matches", "matches", "table is missing", 3, 3),
        ("DELETE FROM matches; DELETE FROM two_view_geometries", "two_view_geometries", "no pairs", 3, 0),
        ("INSERT INTO rig_sensors VALUES (1, 4, 0, NULL)", "rig_sensors", "fixed to a rig", 3, 3),
    ] {
        let (graph, warnings) = Fixture::spoiled(sql).loaded();
        assert_warns(&warnings, table, words);
        assert_eq!((graph.images.len(), graph.pairs.len()), (images, pairs), "{sql}");
    }
    let sql = format!("UPDATE keypoints SET data = CAST({nan} || substr(data, 9) AS BLOB) WHERE image_id = 3");
    let (graph, warnings) = Fixture::spoiled(&sql).loaded();
    assert_warns(&warnings, "keypoints", "1 of 5 keypoints is not finite");
    assert_eq!(graph.pairs[2].inliers, [[4, 3]], "its match is left out");
}

#[test]
fn duplicate_names_and_ids() {
    let tables = "CREATE TABLE copy AS SELECT * FROM images; DROP TABLE images; ALTER TABLE copy RENAME TO images;";
    let (graph, warnings) =
        Fixture::spoiled(&format!("{tables} UPDATE images SET name = 'same' WHERE image_id > 2")).loaded();
    assert_warns(&warnings, "images", "image name same occurs more than once");
    assert_eq!(graph.images.iter().map(|i| i.id).collect::<Vec<_>>(), [2, 3]);
    let (graph, warnings) = Fixture::spoiled(&format!("{tables} INSERT INTO images VALUES (3, 'x', 1)")).loaded();
    assert_warns(&warnings, "images", "image id 3 occurs more than once");
    assert_eq!(graph.images.len(), 3);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Bit flips anywhere (the schema and every page's structure included) and cuts.
    #[test]
    fn damaged_files_never_panic(
        flips in proptest::collection::vec((0usize..1 << 20, 0u8..8), 1..20),
        cut in proptest::option::of(0usize..1 << 20),
        raw_matches: bool,
    ) {
        let fixture = Fixture::new();
        let mut bytes = std::fs::read(&fixture.path).expect("read");
        for (position, bit) in flips {
            let position = position % bytes.len();
            bytes[position] ^= 1 << bit;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut % bytes.len());
        }
        std::fs::write(&fixture.path, bytes).expect("write");
        match read_database(&fixture.path, &ReadOptions { raw_matches }) {
            Ok(loaded) => {
                let graph = loaded.value;
                for pair in &graph.pairs {
                    prop_assert!(pair.image1 < pair.image2 && pair.image2 < graph.images.len());
                    let counts = [pair.image1, pair.image2].map(|i| graph.images[i].keypoints_px.len());
                    for m in pair.inliers.iter().chain(pair.matches.iter().flatten()) {
                        prop_assert!((m[0] as usize) < counts[0] && (m[1] as usize) < counts[1]);
                    }
                }
                prop_assert!(graph.images.iter().all(|i| i.camera < graph.cameras.len()));
            }
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn arbitrary_camera_blobs_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
        let _ = blob::camera(Some(&bytes), "camera1");
    }
}

/// Bytes in memory, which count how many were asked for.
struct Counted(Vec<u8>, std::cell::Cell<usize>);

impl RangedBytes for Counted {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        self.1.set(self.1.get() + out.len());
        out.copy_from_slice(&self.0[offset as usize..offset as usize + out.len()]);
        Ok(())
    }
}

#[test]
fn ranges_give_what_the_file_gives_with_and_without_a_log() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("database.db");
    write_database(&path, &graph()).expect("written");
    let whole = counts(&read_database(&path, &ReadOptions::default()).expect("read").value);
    let ranged = |database: Vec<u8>, wal: Option<Vec<u8>>| {
        let of = |bytes| Rc::new(Counted(bytes, std::cell::Cell::new(0))) as Rc<dyn RangedBytes>;
        read_ranged_database(Path::new("tab.db"), of(database), wal.map(of), &ReadOptions::default())
    };
    let read = |path: &Path| std::fs::read(path).expect("bytes");
    assert_eq!(counts(&ranged(read(&path), None).expect("by ranges").value), whole);

    // A change that is still in the log only.
    let connection = Connection::open(&path).expect("open");
    connection.pragma_update(None, "journal_mode", "WAL").expect("a log");
    connection.pragma_update(None, "wal_autocheckpoint", 0).expect("no checkpoint");
    connection.execute("UPDATE images SET name = 'renamed ' || image_id", []).expect("a change");
    let (database, wal) = (read(&path), read(&folder.path().join("database.db-wal")));
    let names = |loaded: Result<Loaded<ViewGraph>, FormatError>| loaded.expect("read").value.images[0].name.clone();
    assert!(names(ranged(database.clone(), Some(wal))).starts_with("renamed"));
    assert!(!names(ranged(database.clone(), None)).starts_with("renamed"));
    drop(connection);

    for bad in
        [Vec::new(), b"not a database".to_vec(), database[..50].to_vec(), database[..database.len() / 2].to_vec()]
    {
        let error = ranged(bad, None).expect_err("refused").to_string();
        assert!(error.contains("tab.db"), "{error}");
    }
}
