//! Which images share points that a matcher would recognise, and how many.

use glam::DVec3;

use super::layout::Layout;
use super::observe::Keypoint;
use super::options::Options;

/// Descriptors of a point seen from directions farther apart than 50° no longer match.
const MIN_VIEW_COSINE: f64 = 0.643;

/// A pair of images with the keypoints of their common points.
pub(crate) struct Overlap {
    pub(crate) image1: usize,
    pub(crate) image2: usize,
    /// (keypoint in image 1, keypoint in image 2), ordered by the former.
    pub(crate) common: Vec<[u32; 2]>,
}

/// All pairs with at least `min_pair_matches` common points, sorted, thinned to the strongest where asked.
pub(crate) fn find(options: &Options, layout: &Layout, keypoints: &[Vec<Keypoint>]) -> Vec<Overlap> {
    let centers: Vec<DVec3> = layout.cam_from_world.iter().map(|pose| pose.center()).collect();
    let mut seen_by: Vec<Vec<(u32, u32)>> = vec![Vec::new(); options.num_points];
    for (i, image) in keypoints.iter().enumerate() {
        for (k, keypoint) in image.iter().enumerate() {
            if let Some(point) = keypoint.point {
                seen_by[point as usize].push((i as u32, k as u32));
            }
        }
    }
    let mut overlaps = Vec::new();
    for (i, image) in keypoints.iter().enumerate() {
        let mut common: Vec<Vec<[u32; 2]>> = vec![Vec::new(); keypoints.len() - i];
        for (k, keypoint) in image.iter().enumerate() {
            let Some(point) = keypoint.point else { continue };
            let position = layout.points[point as usize].position;
            let direction = (centers[i] - position).normalize_or(DVec3::Z);
            for &(j, l) in &seen_by[point as usize] {
                let recognised =
                    || (centers[j as usize] - position).normalize_or(DVec3::Z).dot(direction) > MIN_VIEW_COSINE;
                if j as usize > i && recognised() {
                    common[j as usize - i].push([k as u32, l]);
                }
            }
        }
        let strong = common.into_iter().enumerate().filter(|(_, c)| c.len() >= options.min_pair_matches.max(1));
        let mut of_image: Vec<_> =
            strong.map(|(offset, common)| Overlap { image1: i, image2: i + offset, common }).collect();
        if let Some(limit) = options.max_pairs_per_image {
            of_image.sort_by_key(|o| (std::cmp::Reverse(o.common.len()), o.image2));
            of_image.truncate(limit);
            of_image.sort_by_key(|o| o.image2);
        }
        overlaps.append(&mut of_image);
    }
    overlaps
}
