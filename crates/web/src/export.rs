//! Models as files in memory; filtered as the view is.

use epipole_formats::{FormatError, ModelFormat, model_files, nerfstudio, ply};
use epipole_scene::Reconstruction;
use serde::Deserialize;

/// What to keep: the same rule as the view's (`pointColors` of `web/scene/colors.js`).
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Filter {
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
pub(crate) fn files(
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
