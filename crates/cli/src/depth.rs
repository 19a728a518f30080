//! Depth maps for `epipole reconstruct`: reads them one by one and says what came of it.

use epipole_formats::depth::attach_depths;
use epipole_mapper::{Event, Observer, Options};
use epipole_scene::ViewGraph;
use epipole_scene::depth::DepthInput;
use serde_json::json;

use crate::args::ReconstructArgs;
use crate::error::CliError;
use crate::progress::Progress;
use crate::{interrupt, output};

/// Refuses a mistyped folder before the work, not after.
pub(crate) fn check(args: &ReconstructArgs) -> Result<(), CliError> {
    match &args.depth_dir {
        Some(folder) if !folder.is_dir() => Err(CliError::Usage(format!(
            "--depth-dir {} is not a folder; give the folder of the depth maps",
            folder.display()
        ))),
        _ => Ok(()),
    }
}

/// Puts the depths of the keypoints into the graph, if there is a folder of depth maps. What is missing or broken becomes
/// a warning.
pub(crate) fn attach(
    args: &ReconstructArgs,
    graph: &mut ViewGraph,
    options: &Options,
    progress: &mut Progress,
    warnings: &mut Vec<String>,
) -> Result<Option<DepthInput>, CliError> {
    let Some(folder) = &args.depth_dir else { return Ok(None) };
    let sidecar = args.depth_sidecar.as_deref();
    let mut go_on = |_, _| !interrupt::requested();
    let input = attach_depths(graph, folder, sidecar, &options.depth, &mut go_on).map_err(CliError::Input)?;
    for message in input.complaints(graph.images.len()) {
        progress.event(&Event::Warning { message: message.clone() });
        warnings.push(message);
    }
    if args.json {
        output::json_line(&json!({ "event": "depth_input", "depth_input": &input }));
    } else {
        progress.say(&format!("{}: {}", folder.display(), summary(&input, graph.images.len())));
    }
    Ok(Some(input))
}

/// One line of counts.
fn summary(input: &DepthInput, images: usize) -> String {
    let percent = |count: usize| format!("{:.1} %", 100.0 * count as f64 / input.keypoints.max(1) as f64);
    let refused = &input.refused;
    let reasons = [
        (refused.no_value, "without a value"),
        (refused.edge, "at an edge"),
        (refused.outside_map, "outside the map"),
        (refused.too_far, "too far"),
        (refused.low_confidence, "too uncertain"),
        (refused.no_ray, "behind the camera"),
    ];
    let mut line = format!(
        "{} of {images} images have a depth map, {} of their keypoints a depth",
        input.maps,
        percent(input.keypoints_with_depth)
    );
    for (count, reason) in reasons.into_iter().filter(|(count, _)| *count > 0) {
        line.push_str(&format!(", {} {reason}", percent(count)));
    }
    line
}
