//! From a folder of depth maps to depths beside the keypoints of a view graph.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use epipole_scene::depth::{DepthInput, DepthKind, DepthMap, DepthOptions, DepthSampler, UnreadableMap, register};
use epipole_scene::{ViewGraph, ViewImage};

use super::folder::{DepthFiles, DepthNames, OnDisk};
use super::sidecar::{DepthSidecar, SIDECAR_NAME};
use super::{read_confidence, read_depths};
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
    let names = DepthNames::open(folder)?;
    let beside = folder.join(SIDECAR_NAME);
    let sidecar = match sidecar {
        Some(path) => DepthSidecar::read(path)?,
        None if beside.is_file() => DepthSidecar::read(&beside)?,
        None => DepthSidecar::default(),
    };
    let attachment = DepthAttachment::new(graph, &names, &OnDisk, sidecar);
    let mut input = DepthInput::default();
    let total = graph.images.len();
    for image in 0..total {
        attachment.attach(graph, image, options, &mut input);
        if !on_map(image + 1, total) {
            break;
        }
    }
    Ok(input)
}

/// Which map belongs to which image of a graph, to be read one at a time.
pub struct DepthAttachment<'a> {
    files: &'a dyn DepthFiles,
    sidecar: DepthSidecar,
    of_image: Vec<Map<'a>>,
}

/// The files of one image.
#[derive(Clone, Copy)]
struct Map<'a> {
    depth: Option<&'a Path>,
    confidence: Option<&'a Path>,
    is_shared: bool,
}

impl<'a> DepthAttachment<'a> {
    /// Finds the maps by the images' names.
    pub fn new(graph: &ViewGraph, names: &'a DepthNames, files: &'a dyn DepthFiles, sidecar: DepthSidecar) -> Self {
        let depths: Vec<Option<&Path>> = graph.images.iter().map(|image| names.depth_of(&image.name)).collect();
        let mut images_of: BTreeMap<&Path, usize> = BTreeMap::new();
        depths.iter().flatten().for_each(|path| *images_of.entry(path).or_default() += 1);
        let map = |(image, depth): (&ViewImage, &Option<&'a Path>)| Map {
            depth: *depth,
            confidence: names.confidence_of(&image.name),
            is_shared: depth.is_some_and(|path| images_of.get(path).is_some_and(|&images| images > 1)),
        };
        let of_image = graph.images.iter().zip(&depths).map(map).collect();
        Self { files, sidecar, of_image }
    }

    /// Reads the map of the image with this index and puts the depths of its keypoints into the graph; counts it in `input`.
    pub fn attach(&self, graph: &mut ViewGraph, image: usize, options: &DepthOptions, input: &mut DepthInput) {
        let ViewGraph { cameras, images, .. } = graph;
        let (Some(image), Some(map)) = (images.get_mut(image), self.of_image.get(image)) else { return };
        let camera = &cameras[image.camera];
        let Some(path) = map.depth else {
            input.missing.push(image.name.clone());
            return;
        };
        let read = if map.is_shared {
            let problem = Problem::Inconsistent("its name fits more than one image".into());
            let advice = "put the maps into folders as the images are";
            Err(FormatError::invalid(Location::file(path), problem, advice))
        } else {
            self.read(path, map.confidence, camera, options)
        };
        match read {
            Ok((map, kind)) => {
                let sampler = DepthSampler::new(&map, kind, camera, options);
                let depths = sampler.sample_all(&image.keypoints_px, &mut input.refused);
                input.maps += 1;
                input.keypoints += depths.len();
                input.keypoints_with_depth += depths.num_known();
                image.depths = Some(Arc::new(depths));
            }
            Err(e) => input.unreadable.push(UnreadableMap { image: image.name.clone(), message: e.to_string() }),
        }
    }

    /// One map as the image's camera sees it.
    fn read(
        &self,
        path: &Path,
        confidence: Option<&Path>,
        camera: &Camera,
        options: &DepthOptions,
    ) -> Result<(DepthMap, DepthKind), FormatError> {
        let sidecar = &self.sidecar;
        let mut map = read_depths(self.files, path, options.scale)?;
        if let Some(confidence) = confidence {
            let (width, height, values) = read_confidence(self.files, confidence, sidecar.full_confidence)?;
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
            FormatError::invalid(
                Location::file(path),
                Problem::Inconsistent(e.to_string()),
                "correct the camera's size",
            )
        })?;
        Ok((drawn, DepthKind::Z))
    }
}
