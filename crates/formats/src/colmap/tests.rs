//! Models: round trips to the bit, COLMAP's own files, and files that are wrong in every way.

use std::path::PathBuf;
use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::{Frame, Image, Observation, Point, Rig, RigSensor, SensorId};
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use tempfile::TempDir;

use super::*;

fn shared(path: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(path);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: no shared data");
    None
}

fn pose(seed: f64) -> Rigid3 {
    Rigid3::new(DQuat::from_xyzw(0.1 * seed, -0.2, 0.3, 0.9), DVec3::new(seed, 1.0 / 3.0, -1e-9))
}

fn sensor(id: u32) -> SensorId {
    SensorId { kind: 0, id }
}

/// Two cameras, three images, ids out of order, awkward numbers.
fn scene() -> Reconstruction {
    let camera = |id, model: CameraModel, params: &[f64]| Camera {
        id,
        model,
        width_px: 640,
        height_px: 480,
        params: params.to_vec(),
        has_prior_focal: false,
    };
    let image = |id, camera, seed| Image {
        id,
        name: format!("a folder/{id}.jpg"),
        camera,
        cam_from_world: pose(seed),
        keypoints_px: Arc::from([DVec2::new(0.5, 1e-7), DVec2::new(-0.0, 1e22), DVec2::new(f64::NAN, 3.25)]),
        depths: None,
    };
    let point = |id, seed: f64, observations: &[(u32, u32)]| Point {
        id,
        position: DVec3::new(seed, 0.1 + 0.2, -5.0),
        rgb: [1, 0, 255],
        error_px: if id == 9 { -1.0 } else { 0.1 },
        observations: observations.iter().map(|&(image, keypoint)| Observation { image, keypoint }).collect(),
    };
    Reconstruction {
        cameras: vec![
            camera(3, CameraModel::SimpleRadial, &[500.0, 320.0, 240.0, 1e-30]),
            camera(1, CameraModel::Pinhole, &[500.1, 500.0 / 3.0, 320.0, 240.0]),
        ],
        images: vec![image(10, 0, 1.0), image(2, 1, -0.5), image(7, 0, 3.0)],
        points: vec![point(9, 1.5, &[(0, 0), (2, 0)]), point(4, -0.0, &[(2, 1), (1, 0), (0, 1)]), point(6, 0.0, &[])],
        ..Default::default()
    }
}

/// The same with a rig of both cameras, whose first frame shows images 10 and 2.
fn rig_scene() -> Reconstruction {
    let mut scene = scene();
    let sensor_from_rig = pose(0.25);
    scene.rigs = vec![Rig {
        id: 5,
        reference: Some(sensor(3)),
        sensors: vec![
            RigSensor { sensor: sensor(1), sensor_from_rig: Some(sensor_from_rig) },
            RigSensor { sensor: SensorId { kind: 1, id: 8 }, sensor_from_rig: None },
        ],
    }];
    let frame = |id, seed, data: &[(u32, u64)]| Frame {
        id,
        rig_id: 5,
        rig_from_world: pose(seed),
        data: data.iter().map(|&(camera, image)| (sensor(camera), image)).collect(),
    };
    scene.frames = vec![frame(2, 1.0, &[(3, 10), (1, 2)]), frame(1, 3.0, &[(3, 7)])];
    scene.images[1].cam_from_world = sensor_from_rig * pose(1.0);
    scene
}

fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .expect("list")
        .map(|entry| {
            let entry = entry.expect("entry");
            (entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path()).expect("read"))
        })
        .collect();
    files.sort();
    files
}

fn clean(loaded: Loaded<Reconstruction>) -> Reconstruction {
    assert!(loaded.warnings.is_empty(), "{:#?}", loaded.warnings);
    loaded.value
}

/// binary → text → binary, compared byte by byte; returns what was read from the text.
fn round_trip(original: &Path, dir: &TempDir) -> Reconstruction {
    let (text, binary) = (dir.path().join("text"), dir.path().join("binary"));
    write_model_text(&text, &clean(read_model(original).expect("read"))).expect("write text");
    let from_text = clean(read_model(&text).expect("read text"));
    write_model_binary(&binary, &from_text).expect("write binary");
    for (name, bytes) in files(original) {
        let back = fs::read(binary.join(&name)).expect("read");
        assert!(bytes == back, "{name} differs after binary, text, binary");
    }
    from_text
}

#[test]
fn binary_text_binary_gives_the_same_bytes() {
    for scene in [scene(), rig_scene(), Reconstruction::default()] {
        let dir = tempfile::tempdir().expect("temp dir");
        let original = dir.path().join("original");
        write_model_binary(&original, &scene).expect("write");
        assert_eq!(files(&original).len(), 5);
        let back = round_trip(&original, &dir);
        assert_eq!(format!("{:?}", back.images), format!("{:?}", scene.images));
        assert_eq!(format!("{:?}", back.points), format!("{:?}", scene.points));
    }
}

#[test]
fn colmaps_own_binary_files_survive() {
    let Some(model) = shared("sceaux_castle/colmap_global") else { return };
    let dir = tempfile::tempdir().expect("temp dir");
    let read = round_trip(&model, &dir);
    assert_eq!([read.images.len(), read.points.len(), read.num_observations()], [11, 5314, 26_991]);
    // What pycolmap 4.2.1 says of this model: the mean over points, whatever the length of their tracks.
    let mean = read.points.iter().map(|p| p.error_px).sum::<f64>() / read.points.len() as f64;
    assert!((mean - 0.685_167_889_246_491_5).abs() < 1e-9, "{mean}");
    let worst = read.points.iter().map(|p| {
        let errors: f64 = p.observations.iter().map(|&o| read.reprojection_error_px(p, o)).sum();
        (errors / p.observations.len() as f64 - p.error_px).abs()
    });
    assert!(worst.fold(0.0, f64::max) < 1e-6, "stored errors agree with the geometry that was read");
}

#[test]
fn models_from_before_rigs_get_them_on_writing() {
    let Some(model) = shared("colmap2017_db/gt/sparse") else { return };
    let read = clean(read_model(&model).expect("read"));
    assert!(read.rigs.is_empty() && read.frames.is_empty() && read.images.len() == 23);
    let dir = tempfile::tempdir().expect("temp dir");
    round_trip(&model, &dir);
    let back = clean(read_model(&dir.path().join("binary")).expect("read"));
    assert_eq!((back.rigs.len(), back.frames.len()), (back.cameras.len(), 23));
}

#[test]
fn poses_come_from_the_frames() {
    let dir = tempfile::tempdir().expect("temp dir");
    let folder = dir.path().join("m");
    let scene = rig_scene();
    write_model_text(&folder, &scene).expect("write");
    // Spoil the poses in the images: COLMAP ignores them.
    let text = fs::read_to_string(folder.join("images.txt")).expect("read");
    let spoiled: String = text
        .lines()
        .map(|line| match line.split_once(" a folder/") {
            Some((head, name)) => {
                let words: Vec<&str> = head.split(' ').collect();
                format!("{} 1 0 0 0 0 0 0 {} a folder/{name}\n", words[0], words[8])
            }
            None => format!("{line}\n"),
        })
        .collect();
    assert_ne!(text, spoiled);
    fs::write(folder.join("images.txt"), spoiled).expect("write");
    let back = clean(read_model(&folder).expect("read"));
    for (a, b) in back.images.iter().zip(&scene.images) {
        assert!(rigs::same_pose(&a.cam_from_world, &b.cam_from_world));
    }
}

#[test]
fn frames_follow_images_that_moved() {
    let dir = tempfile::tempdir().expect("temp dir");
    let folder = dir.path().join("m");
    let moved_together = {
        let mut scene = rig_scene();
        let shift = pose(2.0);
        scene.images.iter_mut().for_each(|i| i.cam_from_world = i.cam_from_world * shift);
        scene
    };
    write_model_binary(&folder, &moved_together).expect("write");
    let back = clean(read_model(&folder).expect("read"));
    assert_eq!(back.rigs, moved_together.rigs, "the rig still holds");
    for (a, b) in back.images.iter().zip(&moved_together.images) {
        assert!(rigs::same_pose(&a.cam_from_world, &b.cam_from_world));
    }
    let mut moved_apart = rig_scene();
    moved_apart.images[1].cam_from_world = pose(9.0);
    write_model_binary(&folder, &moved_apart).expect("write");
    let back = clean(read_model(&folder).expect("read"));
    assert_eq!((back.rigs.len(), back.frames.len()), (2, 3), "the rig no longer holds: one per camera");
    assert_eq!(back.images[1].cam_from_world, moved_apart.images[1].cam_from_world);
}

#[test]
fn writing_replaces_a_whole_model() {
    let dir = tempfile::tempdir().expect("temp dir");
    let folder = dir.path().join("sparse/0");
    write_model_text(&folder, &scene()).expect("write");
    fs::write(folder.join("project.ini"), "mine").expect("write");
    write_model_binary(&folder, &scene()).expect("write");
    let names: Vec<String> = files(&folder).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["cameras.bin", "frames.bin", "images.bin", "points3D.bin", "project.ini", "rigs.bin"]);
    let before = files(&folder);
    let mut bad = scene();
    bad.points[0].observations[0].keypoint = 99;
    assert!(write_model_binary(&folder, &bad).is_err());
    assert_eq!(format!("{:?}", files(&folder)), format!("{before:?}"), "a refused write changes nothing");
    assert_eq!(fs::read_dir(dir.path().join("sparse")).expect("list").count(), 1, "and leaves nothing");
}

#[test]
fn wrong_text_names_file_and_line() {
    let dir = tempfile::tempdir().expect("temp dir");
    let folder = dir.path().join("m");
    for (file, from, to, words) in [
        ("cameras.txt", "SIMPLE_RADIAL", "SIMPLE_RADICAL", "line 4: unknown camera model SIMPLE_RADICAL"),
        ("cameras.txt", "3 SIMPLE_RADIAL 640", "3 SIMPLE_RADIAL wide", "cannot read a width from `wide`"),
        ("cameras.txt", "500 320 240 1e-30", "0 320 240 1e-30", "camera 3: the focal length is 0"),
        ("cameras.txt", " 1e-30", "", "cannot read a camera parameter from `the end of the line`"),
        ("cameras.txt", "1 PINHOLE", "3 PINHOLE", "camera 3 occurs more than once"),
        ("points3D.txt", " 255 ", " 256 ", "cannot read a colour from `256`"),
        ("points3D.txt", " 10 0", " 10", "cannot read a keypoint index"),
        ("images.txt", "a folder/10.jpg", "", "cannot read a file name"),
        ("frames.txt", "CAMERA", "CAMEL", "cannot read a sensor type from `CAMEL`"),
    ] {
        write_model_text(&folder, &scene()).expect("write");
        let text = fs::read_to_string(folder.join(file)).expect("read");
        assert!(text.contains(from), "{file}: {from}");
        fs::write(folder.join(file), text.replacen(from, to, 1)).expect("write");
        let error = read_model(&folder).expect_err(to).to_string();
        assert!(error.contains(words) && error.contains(file), "{error}");
    }
    fs::remove_file(folder.join("points3D.txt")).expect("remove");
    assert!(
        read_model(&folder).expect_err("missing").to_string().contains("points3D.bin (or points3D.txt) is missing")
    );
}

#[test]
fn contradictions_are_dropped_with_a_warning() {
    let dir = tempfile::tempdir().expect("temp dir");
    let folder = dir.path().join("m");
    for (file, from, to, words, images, observations) in [
        ("images.txt", " 3 a folder/7.jpg", " 8 a folder/7.jpg", "camera 8 does not exist", 2, 3),
        ("points3D.txt", " 10 0 7 0", " 10 0 99 0", "image 99 does not exist", 3, 4),
        ("points3D.txt", " 10 0 7 0", " 10 0 7 55", "keypoint 55 of image 7 does not exist", 3, 4),
        ("points3D.txt", " 10 0 7 0", " 10 0 7 2", "refers elsewhere", 3, 4),
        ("points3D.txt", " 10 0 7 0", " 10 0 10 0", "occurs more than once", 3, 4),
        ("points3D.txt", "9 1.5 ", "9 inf ", "the position is not finite", 3, 3),
        ("frames.txt", "3 7\n", "3 70\n", "image 7 is in no frame", 3, 5),
    ] {
        write_model_text(&folder, &scene()).expect("write");
        let text = fs::read_to_string(folder.join(file)).expect("read");
        assert!(text.contains(from), "{file}: {from} in {text}");
        fs::write(folder.join(file), text.replacen(from, to, 1)).expect("write");
        let loaded = read_model(&folder).expect(words);
        let found = loaded.warnings.iter().any(|w| w.to_string().contains(words));
        assert!(found, "no `{words}` in {:#?}", loaded.warnings);
        assert_eq!((loaded.value.images.len(), loaded.value.num_observations()), (images, observations), "{words}");
        write_model_binary(&dir.path().join("out"), &loaded.value).expect("what was read can be written");
    }
}

/// Whatever is wrong with a file, reading ends with an error or with something that can be written.
fn survives(folder: &Path, file: &str, bytes: &[u8]) {
    fs::write(folder.join(file), bytes).expect("write");
    if let Ok(loaded) = read_model(folder) {
        write_model_binary(&folder.join("out"), &loaded.value).expect("what was read can be written");
        write_model_text(&folder.join("out"), &loaded.value).ok();
    }
}

fn damaged() -> impl Strategy<Value = (usize, Vec<(usize, u8)>, Option<usize>)> {
    let flips = proptest::collection::vec((0usize..4096, 0u8..8), 0..6);
    (0usize..5, flips, proptest::option::of(0usize..4096))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn damaged_models_never_panic((part, flips, cut) in damaged(), is_binary: bool) {
        let dir = tempfile::tempdir().expect("temp dir");
        let folder = dir.path().join("m");
        let format = if is_binary { ModelFormat::Binary } else { ModelFormat::Text };
        write_model(&folder, &rig_scene(), format).expect("write");
        let file = format.file(PARTS[part]);
        let mut bytes = fs::read(folder.join(&file)).expect("read");
        for (position, bit) in flips {
            let position = position % bytes.len();
            bytes[position] ^= 1 << bit;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut % (bytes.len() + 1));
        }
        survives(&folder, &file, &bytes);
    }

    #[test]
    fn arbitrary_files_never_panic(part in 0usize..5, bytes in proptest::collection::vec(any::<u8>(), 0..200), is_binary: bool) {
        let dir = tempfile::tempdir().expect("temp dir");
        let folder = dir.path().join("m");
        let format = if is_binary { ModelFormat::Binary } else { ModelFormat::Text };
        write_model(&folder, &scene(), format).expect("write");
        survives(&folder, &format.file(PARTS[part]), &bytes);
    }
}
