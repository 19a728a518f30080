//! Models as files in memory; filtered as the view is.

use epipole_formats::{FormatError, ModelFormat, model_files, nerfstudio, ply};
use epipole_scene::Reconstruction;
use js_sys::{Array, Object, Reflect, Uint8Array};
use serde::Deserialize;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use crate::error::Failure;
use crate::session::{Answer, Session};

/// What to keep: the same rule as the view's (`pointColors` of `web/scene/colors.js`).
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Filter {
    max_error_px: Option<f64>,
    min_track: usize,
}

impl Filter {
    fn apply(&self, reconstruction: &Reconstruction) -> Reconstruction {
        let mut kept = reconstruction.clone();
        let largest = self.max_error_px.unwrap_or(f64::INFINITY);
        kept.points.retain(|point| point.error_px <= largest && point.observations.len() >= self.min_track);
        kept
    }
}

/// The files of one model in the named formats, under `folder`.
fn files(
    reconstruction: &Reconstruction,
    formats: &[String],
    filter: Filter,
    folder: &str,
) -> Result<Vec<(String, Vec<u8>)>, FormatError> {
    let model = filter.apply(reconstruction);
    let mut out = Vec::new();
    for format in formats {
        match format.as_str() {
            "colmap_bin" | "colmap_txt" => {
                let format = if format == "colmap_bin" { ModelFormat::Binary } else { ModelFormat::Text };
                let files = model_files(&model, format)?;
                out.extend(files.into_iter().map(|(name, bytes)| (format!("sparse/{folder}/{name}"), bytes)));
            }
            "ply" => out.push((format!("points-{folder}.ply"), ply::points_file(&model))),
            "transforms" => {
                let files = nerfstudio::nerfstudio_files(&model, "images")?;
                out.extend(files.map(|(name, bytes)| (format!("nerfstudio/{folder}/{name}"), bytes)));
            }
            _ => {}
        }
    }
    Ok(out)
}

#[wasm_bindgen]
impl Session {
    /// Files to download: an array of `{ path, bytes }`.
    pub fn export(
        &self,
        formats: Vec<String>,
        component: Option<usize>,
        filter: JsValue,
        settings: JsValue,
    ) -> Answer<Array> {
        let filter: Filter = serde_wasm_bindgen::from_value(filter).map_err(|e| Failure::new("filter", e, ""))?;
        let out = Array::new();
        let push = |path: &str, bytes: &[u8]| -> Answer<()> {
            let file = Object::new();
            Reflect::set(&file, &"path".into(), &path.into())?;
            Reflect::set(&file, &"bytes".into(), &Uint8Array::from(bytes))?;
            out.push(&file);
            Ok(())
        };
        for (number, model) in self.models.borrow().iter().enumerate() {
            if component.is_some_and(|wanted| wanted != number) {
                continue;
            }
            let folder = number.to_string();
            let files =
                files(&model.reconstruction, &formats, filter, &folder).map_err(|e| Failure::format(&self.name, &e))?;
            for (path, bytes) in files {
                push(&path, &bytes)?;
            }
        }
        if formats.iter().any(|format| format == "report") {
            if let Some(report) = &*self.report.borrow() {
                let json = serde_json::to_vec_pretty(report).map_err(|e| Failure::new("report", e, ""))?;
                push("report.json", &json)?;
            }
            let settings: serde_json::Value =
                serde_wasm_bindgen::from_value(settings).map_err(|e| Failure::new("settings", e, ""))?;
            let json = serde_json::to_vec_pretty(&settings).map_err(|e| Failure::new("settings", e, ""))?;
            push("settings.json", &json)?;
        }
        Ok(out)
    }
}
