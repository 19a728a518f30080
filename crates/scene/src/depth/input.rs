//! What came of looking for the depth maps of a view graph.

use serde::Serialize;

use super::RefusalCounts;

/// What came of reading a folder of depth maps.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DepthInput {
    /// Images whose map was read.
    pub maps: usize,
    /// Names of the images without a map, in the order of the graph.
    pub missing: Vec<String>,
    /// Maps that could not be used.
    pub unreadable: Vec<UnreadableMap>,
    /// Keypoints of the images whose map was read.
    pub keypoints: usize,
    /// Those of them that got a depth.
    pub keypoints_with_depth: usize,
    /// Why the others did not.
    pub refused: RefusalCounts,
}

/// A depth map that could not be used; its image is reconstructed without.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UnreadableMap {
    /// Name of the image.
    pub image: String,
    /// Which file, what is wrong with it.
    pub message: String,
}
