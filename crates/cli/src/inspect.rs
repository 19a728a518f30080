//! `epipole inspect`: what a file holds, and every warning its reader has.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use epipole_formats::{FormatError, ReadOptions, bal, ply, read_database};
use epipole_scene::statistics::Statistics;
use epipole_scene::{Camera, ViewGraph};
use serde_json::{Value, json};

use crate::args::InspectArgs;
use crate::error::CliError;
use crate::{locate, output};

pub(crate) fn run(args: &InspectArgs) -> Result<(), CliError> {
    let path = &args.path;
    let value = if path.is_dir() {
        model(path, args.json)?
    } else {
        match first_bytes(path).map_err(|e| CliError::Input(FormatError::io(path, e)))?.as_slice() {
            [b'S', b'Q', b'L', b'i', ..] | [] => database(path, args.json)?,
            [b'p', b'l', b'y', ..] => {
                let cloud = ply::read_points(path).map_err(CliError::Input)?;
                json!({ "kind": "point cloud", "points": cloud.positions.len(), "coloured": cloud.rgb.is_some() })
            }
            [b'0'..=b'9' | b' ' | b'B', ..] => {
                let problem = bal::read_bal(path).map_err(CliError::Input)?;
                json!({
                    "kind": "BAL problem", "cameras": problem.cameras.len(), "points": problem.points.len(),
                    "observations": problem.observations.len(),
                })
            }
            // The reader of databases says best what such a file is not.
            _ => database(path, args.json)?,
        }
    };
    if args.json {
        output::json_line(&value);
    } else {
        print(&value, 0);
    }
    Ok(())
}

fn first_bytes(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(4).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn cameras(cameras: &[Camera]) -> Value {
    // Thousands of images with a camera each should not fill the screen: count by model and size.
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    for camera in cameras {
        let known = if camera.has_prior_focal { ", known focal length" } else { "" };
        let size = format!("{}x{}", camera.width_px, camera.height_px);
        *kinds.entry(format!("{} {size}{known}", camera.model.name())).or_default() += 1;
    }
    json!({ "count": cameras.len(), "kinds": kinds })
}

fn database(path: &Path, as_json: bool) -> Result<Value, CliError> {
    let loaded = read_database(path, &ReadOptions::default()).map_err(CliError::Input)?;
    output::warnings(&loaded.warnings, as_json);
    let graph: ViewGraph = loaded.value;
    let mut configs: BTreeMap<String, usize> = BTreeMap::new();
    for pair in &graph.pairs {
        *configs.entry(format!("{:?}", pair.config)).or_default() += 1;
    }
    let with_matches = graph.pairs.iter().filter(|p| !p.inliers.is_empty()).count();
    Ok(json!({
        "kind": "COLMAP database",
        "cameras": cameras(&graph.cameras),
        "images": graph.images.len(),
        "keypoints": graph.images.iter().map(|i| i.keypoints_px.len()).sum::<usize>(),
        "pairs": {
            "count": graph.pairs.len(),
            "with_verified_matches": with_matches,
            "with_pose": graph.pairs.iter().filter(|p| p.cam2_from_cam1.is_some()).count(),
            "configs": configs,
        },
        "verified_matches": graph.pairs.iter().map(|p| p.inliers.len()).sum::<usize>(),
        "raw_matches": graph.pairs.iter().map(|p| p.num_matches).sum::<usize>(),
        "warnings": loaded.warnings.len(),
    }))
}

fn model(path: &Path, as_json: bool) -> Result<Value, CliError> {
    let reconstruction = locate::read(path, as_json)?;
    let mut measured = reconstruction.clone();
    epipole_scene::statistics::update_point_errors(&mut measured);
    Ok(json!({
        "kind": "COLMAP model",
        "folder": locate::model_folder(path).display().to_string(),
        "cameras": cameras(&reconstruction.cameras),
        "rigs": reconstruction.rigs.len(),
        "frames": reconstruction.frames.len(),
        "stored": Statistics::of(&reconstruction),
        "recomputed_mean_reprojection_error_px": Statistics::of(&measured).mean_reprojection_error_px,
    }))
}

/// Prints nested values as indented lines.
fn print(value: &Value, depth: usize) {
    let Value::Object(fields) = value else { return };
    for (name, field) in fields {
        let (indent, name) = ("  ".repeat(depth), name.replace('_', " "));
        match field {
            Value::Object(_) => {
                output::line(&format!("{indent}{name}:"));
                print(field, depth + 1);
            }
            Value::String(text) => output::line(&format!("{indent}{name}: {text}")),
            other => output::line(&format!("{indent}{name}: {other}")),
        }
    }
}
