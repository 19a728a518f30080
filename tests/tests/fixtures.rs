//! The committed fixtures are what the synthesiser makes today.

use std::path::{Path, PathBuf};

use epipole_formats::bal::read_bal;
use epipole_formats::depth::attach_depths;
use epipole_formats::{ReadOptions, read_database, read_model};
use epipole_geometry::Rigid3;
use epipole_scene::ViewGraph;
use epipole_scene::depth::DepthOptions;
use epipole_tests::fixtures::{ORBIT_MAPS, folder, scenes, write_all};
use epipole_tests::synth::{BalPerturbation, bal_problem, write_depth_maps};

/// The sine and cosine of another C library may differ in the last bit; a keypoint is an f32 of up to 2000 px.
const KEYPOINT_TOLERANCE_PX: f64 = 1e-3;

/// One unit of the maps.
const DEPTH_TOLERANCE_M: f64 = 0.0011;

/// Names of the images without a map, and the depths of all other images' keypoints, 0 where there is none.
fn depths_in(maps: &Path, graph: &ViewGraph) -> (Vec<String>, Vec<f64>) {
    let mut graph = graph.clone();
    graph.images.iter_mut().for_each(|image| image.depths = None);
    let input = attach_depths(&mut graph, maps, None, &DepthOptions::default(), &mut |_, _| true).expect("maps");
    let found = graph.images.iter().filter_map(|image| image.depths.as_ref());
    let depths_m = found.flat_map(|depths| depths.iter().map(|depth| depth.map_or(0.0, |d| d.z_m))).collect();
    (input.missing, depths_m)
}

fn same_pose(a: Option<Rigid3>, b: Option<Rigid3>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => {
            a.rotation.angle_between(b.rotation) < 1e-5 && a.translation.distance(b.translation) < 1e-5
        }
        (None, None) => true,
        _ => false,
    }
}

fn assert_same_graph(a: &ViewGraph, b: &ViewGraph) {
    assert_eq!(a.cameras, b.cameras);
    assert_eq!(a.images.len(), b.images.len());
    for (a, b) in a.images.iter().zip(&b.images) {
        assert_eq!((a.id, &a.name, a.camera), (b.id, &b.name, b.camera));
        assert_eq!(a.keypoints_px.len(), b.keypoints_px.len());
        for (p, q) in a.keypoints_px.iter().zip(b.keypoints_px.iter()) {
            assert!(p.distance(*q) < KEYPOINT_TOLERANCE_PX, "{}: {p} and {q}", a.name);
        }
    }
    assert_eq!(a.pairs.len(), b.pairs.len());
    for (a, b) in a.pairs.iter().zip(&b.pairs) {
        assert_eq!((a.image1, a.image2, a.config, a.num_matches), (b.image1, b.image2, b.config, b.num_matches));
        assert_eq!((&a.inliers, &a.matches), (&b.inliers, &b.matches));
        assert!(same_pose(a.cam2_from_cam1, b.cam2_from_cam1));
    }
}

#[test]
fn committed_files_are_up_to_date() {
    let [orbit, street] = scenes().expect("scenes");
    let database = folder().join("orbit/database.db");
    let loaded = read_database(&database, &ReadOptions { raw_matches: true }).expect("the fixture");
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    assert_same_graph(&loaded.value, &orbit.graph);

    let truth = read_model(&folder().join("orbit/truth")).expect("the truth").value;
    assert_eq!(truth.points.len(), orbit.truth.points.len());
    for (a, b) in truth.images.iter().zip(&orbit.truth.images) {
        assert!(a.name == b.name && same_pose(Some(a.cam_from_world), Some(b.cam_from_world)));
    }
    for (a, b) in truth.points.iter().zip(&orbit.truth.points) {
        assert_eq!((a.id, a.rgb, &a.observations), (b.id, b.rgb, &b.observations));
        assert!(a.position.distance(b.position) < 1e-6);
    }

    let made = tempfile::tempdir().expect("a temporary folder");
    write_depth_maps(&orbit, made.path(), &ORBIT_MAPS).expect("maps");
    let [committed, made] = [&folder().join("orbit/depth"), made.path()].map(|maps| depths_in(maps, &orbit.graph));
    assert_eq!((&committed.0, committed.1.len()), (&made.0, made.1.len()));
    for (a, b) in committed.1.iter().zip(&made.1) {
        assert!(a == b || (a - b).abs() < DEPTH_TOLERANCE_M, "{a} m and {b} m");
    }

    let bal = read_bal(&folder().join("bal/problem-8-pre.txt")).expect("the BAL fixture");
    let made = bal_problem(&street, &BalPerturbation::default()).expect("a problem");
    assert_eq!((bal.cameras.len(), bal.points.len()), (made.cameras.len(), made.points.len()));
    for (a, b) in bal.observations.iter().zip(&made.observations) {
        assert!((a.0, a.1) == (b.0, b.1) && a.2.distance(b.2) < KEYPOINT_TOLERANCE_PX);
    }
    for (a, b) in bal.cameras.as_flattened().iter().zip(made.cameras.as_flattened()) {
        assert!((a - b).abs() <= 1e-6 * (1.0 + b.abs()));
    }
}

#[test]
fn writing_twice_gives_the_same_bytes() {
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
    for folder in &folders {
        write_all(folder.path()).expect("writing");
    }
    for file in files_below(folders[0].path()) {
        let [a, b] = [0, 1].map(|i| std::fs::read(folders[i].path().join(&file)).expect("a file"));
        assert!(a == b, "{} differs", file.display());
    }
}

#[test]
fn the_repository_stays_small() {
    let size = |path: &PathBuf| std::fs::metadata(folder().join(path)).expect("a file").len();
    let total: u64 = files_below(&folder()).iter().map(size).sum();
    assert!(total < 800_000, "the fixtures have grown to {total} bytes");
}

/// All files, relative to the folder.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(current) = folders.pop() {
        for entry in std::fs::read_dir(&current).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.push(path.strip_prefix(folder).expect("below").to_owned());
            }
        }
    }
    files.sort();
    files
}
