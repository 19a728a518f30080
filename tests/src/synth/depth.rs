//! Depth as sensors and learned models give it: for a part of the keypoints, noisy, sometimes grossly wrong, for some images
//! biased, for some not at all; as depths beside the keypoints or as maps in a folder.

use std::path::Path;
use std::sync::Arc;

use epipole_formats::depth::{write_depth_npy, write_depth_png};
use epipole_scene::depth::{DepthMap, ImageDepths, KeypointDepth};
use glam::DVec2;

use super::random::{Random, Stream};
use super::{Scene, SynthError};

/// What a unit of 16-bit depth maps is worth by habit, and what readers assume.
const PNG_UNIT_M: f64 = 0.001;

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

impl DepthModel {
    fn check(&self) -> Result<(), SynthError> {
        let bad =
            |name, value: f64, expected| Err(SynthError::InvalidOption { name, value: value.to_string(), expected });
        for (name, share) in [
            ("depth share", self.share),
            ("depth gross_share", self.gross_share),
            ("depth biased_map_share", self.biased_map_share),
            ("depth missing_map_share", self.missing_map_share),
        ] {
            if !(0.0..=1.0).contains(&share) {
                return bad(name, share, "a share from 0 to 1");
            }
        }
        if !(self.relative_noise >= 0.0 && self.relative_noise.is_finite()) {
            return bad("depth relative_noise", self.relative_noise, "0 or a positive number");
        }
        if !(self.claimed_sigma > 0.0 && self.claimed_sigma.is_finite()) {
            return bad("depth claimed_sigma", self.claimed_sigma, "a positive number");
        }
        if !(self.bias > -1.0 && self.bias.is_finite()) {
            return bad("depth bias", self.bias, "above -1, so that depths stay positive");
        }
        Ok(())
    }
}

/// Puts depths beside the keypoints of the graph, z-depths in metres. Keypoints of nothing get none.
///
/// # Errors
/// [`SynthError::InvalidOption`] for a scene that was made without [`Options::depth`](super::Options::depth), or for a model
/// with values out of range.
pub fn give_depths(scene: &mut Scene, model: &DepthModel) -> Result<(), SynthError> {
    model.check()?;
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

/// How depth maps are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapFiles {
    /// The files' format.
    pub format: MapFormat,
    /// Side of a square of image pixels that one pixel of the map stands for; positive.
    pub shrink: u64,
}

/// Formats of written depth maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapFormat {
    /// `f4`, metres.
    Npy,
    /// 16-bit grey, millimetres, 0 where there is no depth.
    Png,
}

impl Default for MapFiles {
    fn default() -> Self {
        Self { format: MapFormat::Npy, shrink: 1 }
    }
}

/// Writes the depths beside the keypoints as maps, `folder/NAME.npy` or `.png`, as many images as have depths. A keypoint's
/// depth fills the pixels around it; where two meet, there is none.
///
/// # Errors
/// [`SynthError::InvalidOption`] for maps without pixels, [`SynthError::Io`] where the folder cannot be made,
/// [`SynthError::Format`] where a map cannot be written.
pub fn write_depth_maps(scene: &Scene, folder: &Path, files: &MapFiles) -> Result<(), SynthError> {
    std::fs::create_dir_all(folder).map_err(|source| SynthError::Io { path: folder.to_owned(), source })?;
    for image in &scene.graph.images {
        let Some(depths) = &image.depths else { continue };
        let camera = &scene.graph.cameras[image.camera];
        let [width, height] =
            [camera.width_px, camera.height_px].map(|side| side.checked_div(files.shrink).unwrap_or(0) as usize);
        let map_from_px = DVec2::new(width as f64 / camera.width_px as f64, height as f64 / camera.height_px as f64);
        let mut values = vec![0.0f32; width * height];
        let mut is_taken = vec![false; width * height];
        for (px, depth) in image.keypoints_px.iter().zip(depths.iter()) {
            let Some(depth) = depth else { continue };
            let at = *px * map_from_px;
            // The four values that a bilinear sample takes, and one more on every side, which the search for edges looks at.
            let around = |x: f64, size: usize| {
                let first = ((x - 0.5).floor() as i64 - 1).clamp(0, size as i64) as usize;
                first..(first + 4).min(size)
            };
            for row in around(at.y, height) {
                for column in around(at.x, width) {
                    let pixel = row * width + column;
                    values[pixel] = if is_taken[pixel] { f32::NAN } else { depth.z_m as f32 };
                    is_taken[pixel] = true;
                }
            }
        }
        let map = DepthMap::new(width, height, values).ok_or_else(|| SynthError::InvalidOption {
            name: "shrink",
            value: files.shrink.to_string(),
            expected: "1 or more, and no more than the shorter side of an image",
        })?;
        let stem = image.name.rsplit_once('.').map_or(image.name.as_str(), |(stem, _)| stem);
        match files.format {
            MapFormat::Npy => write_depth_npy(&folder.join(format!("{stem}.npy")), &map)?,
            MapFormat::Png => write_depth_png(&folder.join(format!("{stem}.png")), &map, PNG_UNIT_M)?,
        }
    }
    Ok(())
}
