//! Depth from a sensor or a learned model: maps, their values at keypoints, maps seen from another camera.

mod input;
mod keypoints;
mod map;
mod options;
mod register;
mod sample;
#[cfg(test)]
mod tests;

pub use input::{DepthInput, UnreadableMap};
pub use keypoints::{ImageDepths, KeypointDepth};
pub use map::{DepthKind, DepthMap};
pub use options::DepthOptions;
pub use register::{RegisterError, register};
pub use sample::{DepthSampler, Refusal, RefusalCounts};
