//! Joins points that their keypoints' matches connect and that one position can explain.

use glam::DVec3;

use super::cluster::Cluster;

/// Joins `point` with every point that a match of its track leads to, as long as the mean of the two positions,
/// weighted by track length, projects within `max_error_px` of every observation of both (COLMAP's `Merge`).
/// Returns the number of observations of the merged point, 0 if nothing was joined.
pub(super) fn merge(cluster: &mut Cluster<'_>, point: usize, max_error_px: f64) -> usize {
    let correspondences = cluster.correspondences;
    let mut changed = false;
    // Points that refused the present state of this one.
    let mut refused: Vec<usize> = Vec::new();
    let mut i = 0;
    while i < cluster.point(point).slots.len() {
        let slot = cluster.point(point).slots[i];
        i += 1;
        for &matched in correspondences.matches_of(slot) {
            let Some(other) = cluster.point_of(matched).filter(|&other| other != point) else { continue };
            // Earlier points ended their own turn by refusing every neighbour, this one included if it is as it was.
            if refused.contains(&other) || (!changed && other < point) {
                continue;
            }
            match merged_position(cluster, point, other, max_error_px) {
                Some(position) => {
                    cluster.merge(point, other, position);
                    changed = true;
                    // From a new position and with new neighbours, everything is worth another try.
                    refused.clear();
                    i = 0;
                    break;
                }
                None => refused.push(other),
            }
        }
    }
    if changed { cluster.point(point).slots.len() } else { 0 }
}

fn merged_position(cluster: &Cluster<'_>, a: usize, b: usize, max_error_px: f64) -> Option<DVec3> {
    let (a, b) = (cluster.point(a), cluster.point(b));
    let (weight_a, weight_b) = (a.slots.len() as f64, b.slots.len() as f64);
    let position = (weight_a * a.position + weight_b * b.position) / (weight_a + weight_b);
    let near = |&slot: &u32| cluster.views.squared_error_px2(slot, position) <= max_error_px * max_error_px;
    // The shorter track first: it pulls the mean least and so refuses most often.
    let (short, long) = if a.slots.len() < b.slots.len() { (a, b) } else { (b, a) };
    (short.slots.iter().all(near) && long.slots.iter().all(near)).then_some(position)
}
