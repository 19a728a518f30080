//! Metric scale from depth maps: which depths are believed, how the stages see them, and what is left to say about them.
//!
//! Depths come with the keypoints ([`epipole_scene::Image::depths`]). Positioning pins rays to their length, bundle
//! adjustment gets an inverse-depth row (solver.md §3.1, §5.3). Both are robust against single wrong depths; what they
//! cannot see, a map that is wrong as a whole, is found here by comparing the maps with each other.

mod maps;
mod options;
mod report;
mod rows;
#[cfg(test)]
mod tests;

use epipole_geometry::camera::CameraFamily;
use epipole_scene::{Image, KeypointDepth, Observation, Reconstruction};

pub use options::{DepthStages, DepthWeight, Options};
pub use report::MetricReport;

use maps::MapFit;
pub(crate) use rows::ray_length_m;

/// Fewer depths than this say nothing about the scale of a component.
const MIN_DEPTHS: usize = 20;

/// What is known of a component's scale.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metric {
    options: Options,
    /// One per image of the component.
    maps: Vec<MapFit>,
    state: State,
}

/// Whether lengths are metres.
#[derive(Clone, Debug, Default, PartialEq)]
enum State {
    /// No: no depths, none asked for, or not looked at yet.
    #[default]
    Free,
    /// Yes.
    Metres,
    /// There are depths, but they cannot be believed.
    Refused,
}

impl Metric {
    /// Nothing known yet about the images of a component.
    pub fn new(options: &Options, images: &[Image]) -> Self {
        Self { options: options.clone(), maps: vec![MapFit::default(); images.len()], state: State::Free }
    }

    /// Whether lengths in the component are metres.
    pub fn is_metric(&self) -> bool {
        self.state == State::Metres
    }

    /// Whether positioning is to see depths.
    pub fn pins_rays(&self) -> bool {
        matches!(self.options.stages, DepthStages::Positioning | DepthStages::Both) && self.state != State::Refused
    }

    /// Whether bundle adjustment sees depths.
    fn adjusts(&self) -> bool {
        matches!(self.options.stages, DepthStages::Bundle | DepthStages::Both) && self.is_metric()
    }

    /// Forgets images that leave the component.
    pub(crate) fn retain_images(&mut self, keep: &[bool]) {
        let mut position = 0..;
        self.maps.retain(|_| position.next().is_some_and(|i| keep.get(i).copied().unwrap_or(false)));
    }

    /// Judges the depths at positions that do not depend on their scale or already follow it, and makes the component
    /// metric if they can be believed. Returns why they cannot.
    pub(crate) fn begin(&mut self, reconstruction: &mut Reconstruction) -> Option<String> {
        self.state = State::Free;
        if self.options.stages == DepthStages::Off {
            return None;
        }
        let samples = maps::samples(reconstruction);
        let count: usize = samples.iter().map(Vec::len).sum();
        if count == 0 {
            return None;
        }
        if count < MIN_DEPTHS {
            self.state = State::Refused;
            return Some(format!("only {count} observations have a depth, which is too few to fix the scale"));
        }
        let verdict = maps::fit(&samples, &self.options, &mut self.maps);
        if verdict.agreeing_share < self.options.min_agreeing_share {
            self.state = State::Refused;
            self.maps.fill(MapFit::default());
            return Some(format!(
                "the depth maps contradict the images: only {:.0} % of the depths fit the rays, whatever the scale of \
                 each map; they are not used (check the scale, the kind and the camera of the depth maps)",
                100.0 * verdict.agreeing_share
            ));
        }
        self.state = State::Metres;
        verdict.apply(reconstruction);
        None
    }

    /// Fits the maps again at the present state; with a scale that bundle adjustment does not hold, the scale as well.
    pub(crate) fn refit(&mut self, reconstruction: &mut Reconstruction) {
        if self.is_metric() {
            let verdict = maps::fit(&maps::samples(reconstruction), &self.options, &mut self.maps);
            // Bundle adjustment holds the scale, unless every map has one of its own.
            if !self.adjusts() || self.options.affine {
                verdict.apply(reconstruction);
            }
        }
    }
}

/// The depth of an observation, where the camera's kind has depths: a sphere has no third axis that all its rays share.
fn depth_of(reconstruction: &Reconstruction, observation: Observation) -> Option<KeypointDepth> {
    let image = &reconstruction.images[observation.image as usize];
    if reconstruction.cameras[image.camera].model.family() == CameraFamily::Spherical {
        return None;
    }
    image.depths.as_ref()?.get(observation.keypoint as usize)
}
