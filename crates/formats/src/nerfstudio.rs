//! nerfstudio's `transforms.json` (docs.nerf.studio, "Data conventions"): posed images for radiance fields.

use std::path::Path;

use epipole_geometry::camera::CameraModel;
use epipole_scene::{Camera, Reconstruction};
use glam::{DMat4, DVec3, DVec4};
use serde::Serialize;

use crate::atomic::atomic_write;
use crate::error::{FormatError, Location, Problem};
use crate::ply::transformed_points_file;

/// What nerfstudio's own converter does to the world, `(x, y, z) → (x, z, −y)`: viewers there have z up.
const APPLIED_TRANSFORM: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0]];

/// Name of the point cloud beside the file.
const POINTS_FILE: &str = "sparse_pc.ply";

#[derive(Serialize)]
struct Transforms {
    camera_model: &'static str,
    applied_transform: [[f64; 4]; 3],
    ply_file_path: &'static str,
    frames: Vec<FrameEntry>,
}

#[derive(Serialize)]
struct FrameEntry {
    file_path: String,
    /// OpenGL camera (right, up, backward) to world, row by row.
    transform_matrix: [[f64; 4]; 4],
    colmap_im_id: u32,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Intrinsics {
    w: u64,
    h: u64,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    k1: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k2: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k3: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k4: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    p1: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    p2: Option<f64>,
}

/// Writes `path` (usually `transforms.json`) and the points as `sparse_pc.ply` beside it; both atomic.
/// `image_folder` stands before every image name, relative to the file (usually `images`).
///
/// # Errors
/// Camera models that nerfstudio cannot express, cameras of different kinds in one file, and whatever the file system
/// refuses.
pub fn write_nerfstudio(path: &Path, reconstruction: &Reconstruction, image_folder: &str) -> Result<(), FormatError> {
    for (name, bytes) in files(path, reconstruction, image_folder)?.into_iter().rev() {
        let path = if name == POINTS_FILE { path.with_file_name(POINTS_FILE) } else { path.to_owned() };
        atomic_write(&path, |writer| writer.write_all(&bytes).map_err(|e| FormatError::io(&path, e)))?;
    }
    Ok(())
}

/// The files that [`write_nerfstudio`] writes, in memory: `transforms.json` and the points.
///
/// # Errors
/// Camera models that nerfstudio cannot express, cameras of different kinds in one file.
pub fn nerfstudio_files(
    reconstruction: &Reconstruction,
    image_folder: &str,
) -> Result<[(&'static str, Vec<u8>); 2], FormatError> {
    files(Path::new("transforms.json"), reconstruction, image_folder)
}

fn files(
    path: &Path,
    reconstruction: &Reconstruction,
    image_folder: &str,
) -> Result<[(&'static str, Vec<u8>); 2], FormatError> {
    let mut camera_model: Option<&'static str> = None;
    let mut frames = Vec::with_capacity(reconstruction.images.len());
    for image in &reconstruction.images {
        let camera = &reconstruction.cameras[image.camera];
        let place = || Location::file(path).row(format!("camera {}", camera.id));
        let (model, intrinsics) = intrinsics(camera).ok_or_else(|| {
            let problem = Problem::UnknownCameraModel(format!("{} in nerfstudio", camera.model.name()));
            FormatError::invalid(place(), problem, "undistort the images first")
        })?;
        if *camera_model.get_or_insert(model) != model {
            let problem = Problem::Inconsistent("perspective and other cameras are mixed".into());
            return Err(FormatError::invalid(
                place(),
                problem,
                "nerfstudio takes one kind of camera a file; split the model",
            ));
        }
        let folder = image_folder.trim_end_matches('/');
        let separator = if folder.is_empty() { "" } else { "/" };
        frames.push(FrameEntry {
            file_path: format!("{folder}{separator}{}", image.name),
            transform_matrix: rows(&gl_world_from_camera(&image.cam_from_world)),
            colmap_im_id: image.id,
            intrinsics,
        });
    }
    let transforms = Transforms {
        camera_model: camera_model.unwrap_or("OPENCV"),
        applied_transform: APPLIED_TRANSFORM,
        ply_file_path: POINTS_FILE,
        frames,
    };
    let mut json = serde_json::to_vec_pretty(&transforms).map_err(|e| FormatError::io(path, e.into()))?;
    json.push(b'\n');
    Ok([("transforms.json", json), (POINTS_FILE, transformed_points_file(reconstruction, applied))])
}

fn applied(p: DVec3) -> DVec3 {
    DVec3::new(p.x, p.z, -p.y)
}

/// The camera's axes (right, up, backward) and centre in nerfstudio's world, as columns.
fn gl_world_from_camera(cam_from_world: &epipole_geometry::Rigid3) -> DMat4 {
    let world_from_cam = cam_from_world.inverse();
    let axis = |v: DVec3| applied(world_from_cam.rotation * v).extend(0.0);
    let center = applied(world_from_cam.translation);
    DMat4::from_cols(axis(DVec3::X), axis(-DVec3::Y), axis(-DVec3::Z), DVec4::from((center, 1.0)))
}

fn rows(matrix: &DMat4) -> [[f64; 4]; 4] {
    matrix.transpose().to_cols_array_2d()
}

/// nerfstudio's name of the model and its parameters; `None` for models it does not know.
fn intrinsics(camera: &Camera) -> Option<(&'static str, Intrinsics)> {
    use CameraModel::*;
    let p = &camera.params;
    let plain = |fl_x, fl_y, cx, cy| Intrinsics {
        w: camera.width_px,
        h: camera.height_px,
        fl_x,
        fl_y,
        cx,
        cy,
        k1: None,
        k2: None,
        k3: None,
        k4: None,
        p1: None,
        p2: None,
    };
    let (opencv, fisheye) = ("OPENCV", "OPENCV_FISHEYE");
    Some(match (camera.model, p.as_slice()) {
        (SimplePinhole, &[f, cx, cy]) => (opencv, plain(f, f, cx, cy)),
        (Pinhole, &[fx, fy, cx, cy]) => (opencv, plain(fx, fy, cx, cy)),
        (SimpleRadial, &[f, cx, cy, k]) => (opencv, Intrinsics { k1: Some(k), ..plain(f, f, cx, cy) }),
        (Radial, &[f, cx, cy, k1, k2]) => (opencv, Intrinsics { k1: Some(k1), k2: Some(k2), ..plain(f, f, cx, cy) }),
        (OpenCv, &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            let base = plain(fx, fy, cx, cy);
            (opencv, Intrinsics { k1: Some(k1), k2: Some(k2), p1: Some(p1), p2: Some(p2), ..base })
        }
        (SimpleFisheye, &[f, cx, cy]) => (fisheye, plain(f, f, cx, cy)),
        (Fisheye, &[fx, fy, cx, cy]) => (fisheye, plain(fx, fy, cx, cy)),
        (SimpleRadialFisheye, &[f, cx, cy, k]) => (fisheye, Intrinsics { k1: Some(k), ..plain(f, f, cx, cy) }),
        (RadialFisheye, &[f, cx, cy, k1, k2]) => {
            (fisheye, Intrinsics { k1: Some(k1), k2: Some(k2), ..plain(f, f, cx, cy) })
        }
        (OpenCvFisheye, &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            let base = plain(fx, fy, cx, cy);
            (fisheye, Intrinsics { k1: Some(k1), k2: Some(k2), k3: Some(k3), k4: Some(k4), ..base })
        }
        (Equirectangular, &[w, h]) => ("EQUIRECTANGULAR", plain(h, w / 2.0, w / 2.0, h / 2.0)),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use epipole_geometry::Rigid3;
    use epipole_scene::Image;
    use glam::DQuat;

    use super::*;

    fn scene(model: CameraModel, params: &[f64]) -> Reconstruction {
        let camera =
            Camera { id: 1, model, width_px: 640, height_px: 480, params: params.to_vec(), has_prior_focal: false };
        let image = Image {
            id: 7,
            name: "a/b.jpg".into(),
            camera: 0,
            cam_from_world: Rigid3::new(DQuat::from_xyzw(0.1, 0.2, -0.3, 0.9), DVec3::new(1.0, -2.0, 3.0)),
            keypoints_px: Arc::from([]),
            depths: None,
        };
        Reconstruction { cameras: vec![camera], images: vec![image], ..Default::default() }
    }

    #[test]
    fn a_point_ahead_of_the_camera_lies_on_its_negative_z_axis() {
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("transforms.json");
        let scene = scene(CameraModel::SimpleRadial, &[500.0, 320.0, 240.0, 0.01]);
        write_nerfstudio(&path, &scene, "images").expect("write");
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).expect("read")).expect("json");
        let frame = &json["frames"][0];
        assert_eq!(frame["file_path"], "images/a/b.jpg");
        assert_eq!((frame["fl_y"].as_f64(), frame["k1"].as_f64(), frame.get("k2")), (Some(500.0), Some(0.01), None));
        let m = DMat4::from_cols_array_2d(&std::array::from_fn(|r| {
            std::array::from_fn(|c| frame["transform_matrix"][r][c].as_f64().expect("number"))
        }))
        .transpose();
        assert!((m.determinant() - 1.0).abs() < 1e-12, "a proper motion");
        // 2 right, 1 down, 5 ahead.
        let world = scene.images[0].cam_from_world.inverse().transform_point(DVec3::new(2.0, 1.0, 5.0));
        let in_gl = m.inverse().transform_point3(applied(world));
        assert!((in_gl - DVec3::new(2.0, -1.0, -5.0)).length() < 1e-12, "{in_gl}");
        assert!(dir.path().join(POINTS_FILE).exists());
    }

    #[test]
    fn models_nerfstudio_does_not_know_are_refused() {
        let dir = tempfile::tempdir().expect("temp dir");
        let scene = scene(CameraModel::Fov, &[500.0, 500.0, 320.0, 240.0, 0.9]);
        let error = write_nerfstudio(&dir.path().join("t.json"), &scene, "").expect_err("refused");
        assert!(error.to_string().contains("FOV"), "{error}");
        assert_eq!(std::fs::read_dir(dir.path()).expect("list").count(), 0);
    }
}
