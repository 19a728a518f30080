//! What came of looking for the depth maps of a view graph.

use serde::Serialize;

use super::RefusalCounts;

/// Names in a line for people; all of them are in report.json.
const MAX_NAMES: usize = 5;

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

impl DepthInput {
    /// What a person should know, a line each; `images` is how many there are in all.
    pub fn complaints(&self, images: usize) -> Vec<String> {
        let mut lines = Vec::new();
        if !self.missing.is_empty() {
            let names: Vec<&str> = self.missing.iter().take(MAX_NAMES).map(String::as_str).collect();
            let more = match self.missing.len().saturating_sub(MAX_NAMES) {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            lines.push(format!(
                "no depth map for {} of {images} images: {}{more}",
                self.missing.len(),
                names.join(", ")
            ));
        }
        lines.extend(self.unreadable.iter().take(MAX_NAMES).map(|u| format!("{}: {}", u.image, u.message)));
        let more = self.unreadable.len().saturating_sub(MAX_NAMES);
        if more > 0 {
            lines.push(format!("{more} more depth maps could not be read; report.json names them"));
        }
        if self.maps > 0 && self.keypoints_with_depth == 0 {
            lines.push("no keypoint has a depth; check depth.scale and depth.max_m (--depth-scale, --depth-max) and the size of the maps".into());
        }
        lines
    }
}

/// A depth map that could not be used; its image is reconstructed without.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UnreadableMap {
    /// Name of the image.
    pub image: String,
    /// Which file, what is wrong with it.
    pub message: String,
}
