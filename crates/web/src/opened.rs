//! What was opened, as the page needs it: `Opened` of `web/engine/protocol.js`.

use epipole_geometry::camera::Camera;
use epipole_scene::{Reconstruction, ViewGraph};
use js_sys::{Object, Reflect, Uint32Array};
use serde::Serialize;
use wasm_bindgen::JsValue;

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct ImageInfo {
    id: u32,
    name: String,
    width: usize,
    height: usize,
    keypoints: usize,
    camera: usize,
}

#[derive(Serialize)]
pub(crate) struct CameraInfo {
    id: u32,
    model: &'static str,
    width: usize,
    height: usize,
    params: Vec<f64>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Facts<'a> {
    kind: &'static str,
    name: &'a str,
    images: Vec<ImageInfo>,
    cameras: Vec<CameraInfo>,
    bytes: f64,
    predicted_bytes: f64,
    warnings: Vec<String>,
}

fn image(cameras: &[Camera], id: u32, name: &str, camera: usize, keypoints: usize) -> ImageInfo {
    let size = cameras.get(camera).map_or((0, 0), |c| (c.width_px as usize, c.height_px as usize));
    ImageInfo { id, name: name.to_owned(), width: size.0, height: size.1, keypoints, camera }
}

fn cameras(cameras: &[Camera]) -> Vec<CameraInfo> {
    let info = |c: &Camera| CameraInfo {
        id: c.id,
        model: c.model.name(),
        width: c.width_px as usize,
        height: c.height_px as usize,
        params: c.params.clone(),
    };
    cameras.iter().map(info).collect()
}

fn with_pairs(facts: &Facts<'_>, pairs: &[u32]) -> Result<JsValue, JsValue> {
    let value = serde_wasm_bindgen::to_value(facts).map_err(|e| JsValue::from_str(&e.to_string()))?;
    Reflect::set(&Object::from(value.clone()), &"pairs".into(), &Uint32Array::from(pairs))?;
    Ok(value)
}

/// A database.
pub(crate) fn graph(
    name: &str,
    graph: &ViewGraph,
    warnings: Vec<String>,
    bytes: f64,
    predicted_bytes: f64,
) -> Result<JsValue, JsValue> {
    let images = graph.images.iter().map(|i| image(&graph.cameras, i.id, &i.name, i.camera, i.keypoints_px.len()));
    let pairs: Vec<u32> =
        graph.pairs.iter().flat_map(|p| [p.image1 as u32, p.image2 as u32, p.inliers.len() as u32]).collect();
    let facts = Facts {
        kind: "database",
        name,
        images: images.collect(),
        cameras: cameras(&graph.cameras),
        bytes,
        predicted_bytes,
        warnings,
    };
    with_pairs(&facts, &pairs)
}

/// A model: its pairs are the images that share points.
pub(crate) fn model(name: &str, model: &Reconstruction, warnings: Vec<String>, bytes: f64) -> Result<JsValue, JsValue> {
    let images = model.images.iter().map(|i| image(&model.cameras, i.id, &i.name, i.camera, i.keypoints_px.len()));
    let mut shared: std::collections::BTreeMap<(u32, u32), u32> = std::collections::BTreeMap::new();
    for point in &model.points {
        for (k, a) in point.observations.iter().enumerate() {
            for b in &point.observations[k + 1..] {
                if a.image != b.image {
                    *shared.entry((a.image.min(b.image), a.image.max(b.image))).or_default() += 1;
                }
            }
        }
    }
    let pairs: Vec<u32> = shared.into_iter().flat_map(|((a, b), count)| [a, b, count]).collect();
    let facts = Facts {
        kind: "model",
        name,
        images: images.collect(),
        cameras: cameras(&model.cameras),
        bytes,
        predicted_bytes: 2.0 * bytes,
        warnings,
    };
    with_pairs(&facts, &pairs)
}
