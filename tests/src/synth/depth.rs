//! Depth as sensors and learned models give it: for a part of the keypoints, noisy, sometimes grossly wrong, for some images
//! biased, for some not at all; as depths beside the keypoints or as maps in a folder.

use std::path::Path;
use std::sync::Arc;

use epipole_formats::depth::write_depth_npy;
use epipole_scene::depth::{DepthMap, ImageDepths, KeypointDepth};

use super::random::{Random, Stream};
use super::{Scene, SynthError};

/// What is wrong with the depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthModel {
    /// Share of the keypoints with depth, in the images that have a map.
    pub share: f64,
    /// Standard deviation of the relative error.
    pub relative_noise: f64,
    /// Share of the depths that are anything between a quarter and four times the truth.
    pub gross_share: f64,
    /// Share of the maps whose depths are all too large by `bias`.
    pub biased_map_share: f64,
    /// Relative.
    pub bias: f64,
    /// Share of the images without a map.
    pub missing_map_share: f64,
    /// The standard deviation that the depths claim; [`Self::relative_noise`] if that is positive.
    pub claimed_sigma: f64,
    /// Everything random follows from it.
    pub seed: u64,
}

impl Default for DepthModel {
    fn default() -> Self {
        Self {
            share: 1.0,
            relative_noise: 0.0,
            gross_share: 0.0,
            biased_map_share: 0.0,
            bias: 0.1,
            missing_map_share: 0.0,
            claimed_sigma: 0.05,
            seed: 0,
        }
    }
}

/// Puts depths beside the keypoints of the graph, z-depths in metres. Keypoints of nothing get none.
///
/// # Errors
/// [`SynthError::InvalidOption`] for a scene that was made without [`Options::depth`](super::Options::depth).
pub fn give_depths(scene: &mut Scene, model: &DepthModel) -> Result<(), SynthError> {
    let truth = scene.depth_m.as_ref().ok_or_else(|| SynthError::InvalidOption {
        name: "depth",
        value: "false".into(),
        expected: "make the scene with its depths kept",
    })?;
    let mut random = Random::new(model.seed, Stream::Depths);
    for (image, truth) in scene.graph.images.iter_mut().zip(truth) {
        let is_missing = random.chance(model.missing_map_share);
        let bias = if random.chance(model.biased_map_share) { 1.0 + model.bias } else { 1.0 };
        let depths = ImageDepths::new(truth.iter().map(|&z_m| {
            // Always drawn, so that one option does not change what another does.
            let (is_kept, is_gross) = (random.chance(model.share), random.chance(model.gross_share));
            let (noise, gross) = (1.0 + model.relative_noise * random.gaussian(), 4f64.powf(random.uniform(-1.0, 1.0)));
            let relative_sigma = if model.relative_noise > 0.0 { model.relative_noise } else { model.claimed_sigma };
            let factor = if is_gross { gross } else { noise * bias };
            (is_kept && !is_missing).then_some(KeypointDepth { z_m: z_m * factor, relative_sigma })
        }));
        image.depths = (!is_missing).then(|| Arc::new(depths));
    }
    Ok(())
}

/// Writes the depths beside the keypoints as maps, `folder/NAME.npy`, as many images as have depths. A keypoint's depth
/// fills the pixels around it; where two meet, there is none.
///
/// # Errors
/// [`SynthError::Io`] where the folder cannot be made, [`SynthError::Format`] where a map cannot be written.
pub fn write_depth_maps(scene: &Scene, folder: &Path) -> Result<(), SynthError> {
    std::fs::create_dir_all(folder).map_err(|source| SynthError::Io { path: folder.to_owned(), source })?;
    for image in &scene.graph.images {
        let Some(depths) = &image.depths else { continue };
        let camera = &scene.graph.cameras[image.camera];
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let mut values = vec![0.0f32; width * height];
        let mut owner = vec![None; width * height];
        for (keypoint, (px, depth)) in image.keypoints_px.iter().zip(depths.iter()).enumerate() {
            let Some(depth) = depth else { continue };
            let around = |x: f64, size: usize| {
                let first = ((x - 0.5).floor() as i64 - 1).clamp(0, size as i64) as usize;
                first..(first + 4).min(size)
            };
            for row in around(px.y, height) {
                for column in around(px.x, width) {
                    let pixel = row * width + column;
                    values[pixel] = if owner[pixel].is_none() { depth.z_m as f32 } else { f32::NAN };
                    owner[pixel] = Some(keypoint);
                }
            }
        }
        let stem = image.name.rsplit_once('.').map_or(image.name.as_str(), |(stem, _)| stem);
        if let Some(map) = DepthMap::new(width, height, values) {
            write_depth_npy(&folder.join(format!("{stem}.npy")), &map)?;
        }
    }
    Ok(())
}
