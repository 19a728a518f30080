//! From a folder of depth maps to depths beside the keypoints of a view graph.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use epipole_scene::ViewGraph;
use epipole_scene::depth::{DepthInput, DepthKind, DepthMap, DepthOptions, DepthSampler, UnreadableMap, register};

use super::folder::DepthFolder;
use super::sidecar::{DepthSidecar, SIDECAR_NAME};
use super::{read_confidence, read_depth_map};
use crate::error::{FormatError, Location, Problem};

/// Finds the depth map of every image by name, reads it and puts the depths of the keypoints into the graph, one map after
/// the other. `on_map` is told of every image when it is done with; it may ask to stop by returning `false`.
///
/// The sidecar is `sidecar` or, if that is not given, [`SIDECAR_NAME`] in the folder where it exists.
///
/// # Errors
/// A folder that cannot be listed or a bad sidecar. A map that is missing or broken is not an error but reported.
pub fn attach_depths(
    graph: &mut ViewGraph,
    folder: &Path,
    sidecar: Option<&Path>,
    options: &DepthOptions,
    on_map: &mut dyn FnMut(usize, usize) -> bool,
) -> Result<DepthInput, FormatError> {
    let files = DepthFolder::open(folder)?;
    let beside = folder.join(SIDECAR_NAME);
    let sidecar = match sidecar {
        Some(path) => DepthSidecar::read(path)?,
        None if beside.is_file() => DepthSidecar::read(&beside)?,
        None => DepthSidecar::default(),
    };
    let maps: Vec<Option<&Path>> = graph.images.iter().map(|image| files.depth_of(&image.name)).collect();
    let mut images_of: BTreeMap<&Path, usize> = BTreeMap::new();
    maps.iter().flatten().for_each(|path| *images_of.entry(path).or_default() += 1);

    let mut input = DepthInput::default();
    let total = maps.len();
    for (index, (image, path)) in graph.images.iter_mut().zip(&maps).enumerate() {
        let camera = &graph.cameras[image.camera];
        let read = path.map(|path| {
            if images_of.get(path).is_some_and(|&images| images > 1) {
                let problem = Problem::Inconsistent("its name fits more than one image".into());
                let advice = "put the maps into folders as the images are";
                return Err(FormatError::invalid(Location::file(path), problem, advice));
            }
            read_map(path, files.confidence_of(&image.name), camera, &sidecar, options)
        });
        match read {
            None => input.missing.push(image.name.clone()),
            Some(Ok((map, kind))) => {
                let sampler = DepthSampler::new(&map, kind, camera, options);
                let depths = sampler.sample_all(&image.keypoints_px, &mut input.refused);
                input.maps += 1;
                input.keypoints += depths.len();
                input.keypoints_with_depth += depths.num_known();
                image.depths = Some(Arc::new(depths));
            }
            Some(Err(e)) => input.unreadable.push(UnreadableMap { image: image.name.clone(), message: e.to_string() }),
        }
        if !on_map(index + 1, total) {
            break;
        }
    }
    Ok(input)
}

/// One map as the image's camera sees it.
fn read_map(
    path: &Path,
    confidence: Option<&Path>,
    camera: &Camera,
    sidecar: &DepthSidecar,
    options: &DepthOptions,
) -> Result<(DepthMap, DepthKind), FormatError> {
    let mut map = read_depth_map(path, options.scale)?;
    if let Some(confidence) = confidence {
        let (width, height, values) = read_confidence(confidence, sidecar.full_confidence)?;
        let size = [map.width(), map.height()];
        if [width, height] != size {
            let [w, h] = size;
            let problem = Problem::Inconsistent(format!("{width} × {height} confidences for {w} × {h} depths"));
            return Err(FormatError::invalid(Location::file(confidence), problem, "give one confidence a depth"));
        }
        map = map.with_confidence(values).ok_or_else(|| {
            FormatError::invalid(Location::file(confidence), Problem::Empty, "give one confidence a depth")
        })?;
    }
    let Some(depth_camera) = &sidecar.depth_camera else { return Ok((map, options.kind)) };
    let color_from_depth = sidecar.color_from_depth.unwrap_or(Rigid3::IDENTITY);
    let color_camera = sidecar.color_camera.as_ref().unwrap_or(camera);
    let drawn = register(&map, options.kind, depth_camera, &color_from_depth, color_camera, options.max_jump);
    let drawn = drawn.map_err(|e| {
        FormatError::invalid(Location::file(path), Problem::Inconsistent(e.to_string()), "correct the camera's size")
    })?;
    Ok((drawn, DepthKind::Z))
}
