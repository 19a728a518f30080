//! How much memory a solve will take, before it takes it.

use epipole_scene::ViewGraph;

/// What a wasm module can address, less what a browser needs of it for itself.
pub(crate) const LIMIT_BYTES: f64 = 3.6e9;

/// Bytes of the engine itself, measured in an idle tab.
const BASE_BYTES: f64 = 24e6;
/// Bytes per keypoint, verified match and observation at the peak of a run. Measured over the benchmark scenes with the
/// command line (`cargo xtask bench all`): peak memory against these three counts, rounded up.
const BYTES_PER_KEYPOINT: f64 = 40.0;
const BYTES_PER_MATCH: f64 = 90.0;

/// A prediction for a graph that has been read, bytes.
pub(crate) fn predicted_bytes(graph: &ViewGraph) -> f64 {
    let keypoints: usize = graph.images.iter().map(|image| image.keypoints_px.len()).sum();
    let matches: usize = graph.pairs.iter().map(|pair| pair.inliers.len()).sum();
    BASE_BYTES + BYTES_PER_KEYPOINT * keypoints as f64 + BYTES_PER_MATCH * matches as f64
}
