//! What a person can say about depth maps and how far to believe them.

use serde::{Deserialize, Serialize};

use super::DepthKind;

/// How depth maps are read and sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthOptions {
    /// Metres a unit; if not given, 0.001 for whole numbers (the habit of sensors) and 1 for floating-point numbers.
    pub scale: Option<f64>,
    /// What the numbers measure.
    pub kind: DepthKind,
    /// Standard deviation of a depth divided by the depth.
    pub relative_sigma: f64,
    /// Values beyond this count as unknown, metres.
    pub max_m: f64,
    /// Largest relative difference between the values around a keypoint; beyond it lies the edge of an object.
    pub max_jump: f64,
    /// How far around the four nearest values such an edge is looked for as well, pixels of the map.
    pub edge_margin_px: usize,
    /// Values with a lower confidence (0 to 1) count as unknown.
    pub min_confidence: f64,
}

impl Default for DepthOptions {
    fn default() -> Self {
        Self {
            scale: None,
            kind: DepthKind::default(),
            // Between a structured-light sensor (1–2 %) and learned metric depth (10 %).
            relative_sigma: 0.05,
            // Farther than any sensor sees; below the background values that renderers write (65 504, 1e10).
            max_m: 1e4,
            // A surface seen at 80° from its normal changes by tan 80° / f a pixel: 1 % at f = 585 px, 4 % at f = 146 px.
            max_jump: 0.05,
            // Keypoints sit on outlines, and maps are not registered to the images better than this.
            edge_margin_px: 1,
            min_confidence: 0.2,
        }
    }
}

/// A confidence `c` stands for a standard deviation `1/√c` times as large: it multiplies the weight of the depth.
pub(super) fn relative_sigma(options: &DepthOptions, confidence: f64) -> f64 {
    options.relative_sigma / confidence.sqrt()
}
