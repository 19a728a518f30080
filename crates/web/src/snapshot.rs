//! A scene as flat arrays, to be drawn: `Snapshot` of `web/engine/protocol.js`.

use epipole_geometry::camera::Camera;
use epipole_optimize::lm::Places;
use epipole_scene::{Point, Reconstruction};
use glam::{DMat3, DVec3};
use js_sys::{Float32Array, Object, Reflect, Uint8Array, Uint16Array, Uint32Array};
use wasm_bindgen::JsValue;

/// Points and cameras of any number of components, one after the other.
#[derive(Clone, Debug, Default)]
pub(crate) struct Arrays {
    positions: Vec<f32>,
    colors: Vec<u8>,
    errors: Vec<f32>,
    tracks: Vec<u16>,
    point_component: Vec<u16>,
    camera_image: Vec<u32>,
    cameras: Vec<f32>,
    camera_shape: Vec<f32>,
    camera_component: Vec<u16>,
    camera_errors: Vec<f32>,
}

/// The colour of points that no photograph has coloured.
const UNCOLORED: [u8; 3] = [190, 196, 206];

impl Arrays {
    /// Appends a component whose positions a solve is just changing. Errors are unknown: there is no time for them.
    pub(crate) fn push_preview(
        &mut self,
        number: usize,
        reconstruction: &Reconstruction,
        image_of: impl Fn(usize) -> usize,
        places: &Places,
    ) {
        let (first_point, first_camera) = (self.tracks.len(), self.camera_image.len());
        self.append(number, reconstruction, image_of, |_| -1.0);
        let put = |at: &mut [f32], position: DVec3| at.copy_from_slice(&position.as_vec3().to_array());
        for &(point, position) in &places.points {
            let at = 3 * (first_point + point as usize);
            put(&mut self.positions[at..at + 3], position);
        }
        for &(image, center) in &places.centers {
            let at = 12 * (first_camera + image as usize);
            for (row, coordinate) in center.to_array().into_iter().enumerate() {
                self.cameras[at + 4 * row + 3] = coordinate as f32;
            }
        }
        self.camera_errors.resize(self.camera_image.len(), -1.0);
    }

    /// Appends a component; `image_of` gives each of its images its place among all.
    pub(crate) fn push(&mut self, number: usize, reconstruction: &Reconstruction, image_of: impl Fn(usize) -> usize) {
        let mut sums = vec![(0.0, 0u32); reconstruction.images.len()];
        self.append(number, reconstruction, image_of, |point| {
            let mut sum = 0.0;
            for &observation in &point.observations {
                let error = reconstruction.reprojection_error_px(point, observation);
                let image = &mut sums[observation.image as usize];
                // A point behind a camera has no error in pixels.
                if error.is_finite() {
                    sum += error;
                    *image = (image.0 + error, image.1 + 1);
                }
            }
            if point.observations.is_empty() { -1.0 } else { (sum / point.observations.len() as f64) as f32 }
        });
        let mean = |(sum, count): (f64, u32)| if count == 0 { -1.0 } else { (sum / f64::from(count)) as f32 };
        self.camera_errors.extend(sums.into_iter().map(mean));
    }

    fn append(
        &mut self,
        number: usize,
        reconstruction: &Reconstruction,
        image_of: impl Fn(usize) -> usize,
        mut error_px: impl FnMut(&Point) -> f32,
    ) {
        let number = number.min(usize::from(u16::MAX)) as u16;
        for point in &reconstruction.points {
            self.positions.extend(point.position.as_vec3().to_array());
            self.colors.extend(if point.rgb == [0; 3] { UNCOLORED } else { point.rgb });
            self.errors.push(error_px(point));
            self.tracks.push(point.observations.len().min(usize::from(u16::MAX)) as u16);
            self.point_component.push(number);
        }
        for (k, image) in reconstruction.images.iter().enumerate() {
            let world_from_cam = DMat3::from_quat(image.cam_from_world.rotation).transpose();
            let center = image.cam_from_world.center();
            for row in 0..3 {
                self.cameras.extend(world_from_cam.row(row).as_vec3().to_array());
                self.cameras.push(center[row] as f32);
            }
            self.camera_shape.extend(shape(&reconstruction.cameras[image.camera]));
            self.camera_image.push(image_of(k) as u32);
            self.camera_component.push(number);
        }
    }

    /// Moves everything into JavaScript.
    pub(crate) fn to_js(&self, is_final: bool) -> Result<JsValue, JsValue> {
        let object = Object::new();
        let set = |name: &str, value: &JsValue| Reflect::set(&object, &name.into(), value).map(|_| ());
        set("positions", &Float32Array::from(&self.positions[..]))?;
        set("colors", &Uint8Array::from(&self.colors[..]))?;
        set("errors", &Float32Array::from(&self.errors[..]))?;
        set("tracks", &Uint16Array::from(&self.tracks[..]))?;
        set("pointComponent", &Uint16Array::from(&self.point_component[..]))?;
        set("cameraImage", &Uint32Array::from(&self.camera_image[..]))?;
        set("cameras", &Float32Array::from(&self.cameras[..]))?;
        set("cameraShape", &Float32Array::from(&self.camera_shape[..]))?;
        set("cameraComponent", &Uint16Array::from(&self.camera_component[..]))?;
        set("cameraErrors", &Float32Array::from(&self.camera_errors[..]))?;
        set("final", &is_final.into())?;
        Ok(object.into())
    }
}

/// Half width and height of the picture on the plane z = 1, and where its middle lies there.
fn shape(camera: &Camera) -> [f32; 4] {
    let (width, height) = (camera.width_px as f64, camera.height_px as f64);
    let focal = camera.model.focal_params().iter().map(|&k| camera.params[k]).sum::<f64>()
        / camera.model.focal_params().len().max(1) as f64;
    // A fisheye sees to the side and behind: its frustum is a sign, not a volume.
    let half = |size: f64| if focal > 0.0 { (size / (2.0 * focal)).min(1.5) } else { 0.5 };
    [half(width) as f32, half(height) as f32, 0.0, 0.0]
}
