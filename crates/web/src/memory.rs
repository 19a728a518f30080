//! How much memory a solve will take, before it takes it.

use epipole_scene::ViewGraph;

/// What a wasm module can address, less what a browser needs of it for itself.
pub(crate) const LIMIT_BYTES: f64 = 3.6e9;

/// Bytes of the engine itself, and per keypoint and verified match at the peak of a run: the smallest round numbers that are
/// not below what a tab's memory had grown to after Herz-Jesus-P8, -P25, castle-P19, sceaux_castle and bonsai292 (16, 55, 34,
/// 24 and 268 MB; the prediction for the last is 340).
const BASE_BYTES: f64 = 6e6;
const BYTES_PER_KEYPOINT: f64 = 170.0;
const BYTES_PER_MATCH: f64 = 200.0;

/// A prediction for a graph that has been read, bytes.
pub(crate) fn predicted_bytes(graph: &ViewGraph) -> f64 {
    let keypoints: usize = graph.images.iter().map(|image| image.keypoints_px.len()).sum();
    let matches: usize = graph.pairs.iter().map(|pair| pair.inliers.len()).sum();
    BASE_BYTES + BYTES_PER_KEYPOINT * keypoints as f64 + BYTES_PER_MATCH * matches as f64
}
