//! Takes sets of matched keypoints with a conflict apart, so that one wrong match does not cost the whole track.

use epipole_scene::ViewGraph;

use super::KeypointTable;

/// Joins the keypoints of conflicting sets again, the matches of the pairs with most inliers first, and leaves out every
/// match that would bring two keypoints of one image together that are further apart than `max_distance_px`.
///
/// `members` are the keypoints of the conflicting sets, ascending; the result is sets of two or more, ascending inside,
/// in the order of their first keypoint.
pub(super) fn split(
    graph: &ViewGraph,
    keypoints: &KeypointTable<'_>,
    pairs: &[usize],
    members: &[u32],
    max_distance_px: f64,
) -> Vec<Vec<u32>> {
    let mut strongest_first = pairs.to_vec();
    strongest_first.sort_by_key(|&p| (std::cmp::Reverse(graph.pairs[p].inliers.len()), p));
    // Every member names the slot that holds its set; an emptied slot is named by no one.
    let mut slot: Vec<u32> = (0..members.len() as u32).collect();
    let mut sets: Vec<Vec<u32>> = (0..members.len() as u32).map(|k| vec![k]).collect();
    let local = |keypoint: usize| members.binary_search(&(keypoint as u32)).ok();
    for p in strongest_first {
        for (a, b) in keypoints.matches(graph, p) {
            let (Some(a), Some(b)) = (local(a), local(b)) else { continue };
            let (a, b) = (slot[a] as usize, slot[b] as usize);
            if a == b {
                continue;
            }
            let mut union: Vec<u32> = sets[a].iter().chain(&sets[b]).copied().collect();
            union.sort_unstable();
            let global: Vec<u32> = union.iter().map(|&k| members[k as usize]).collect();
            if keypoints.is_consistent(&global, max_distance_px) {
                let (keep, empty) = (a.min(b), a.max(b));
                for &k in &sets[empty] {
                    slot[k as usize] = keep as u32;
                }
                sets[empty] = Vec::new();
                sets[keep] = union;
            }
        }
    }
    let sets = sets.into_iter().filter(|s| s.len() >= 2);
    sets.map(|s| s.iter().map(|&k| members[k as usize]).collect()).collect()
}
