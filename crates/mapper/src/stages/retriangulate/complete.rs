//! Adds to a point the keypoints that its own keypoints match, where it projects near them.

use super::cluster::Cluster;

/// Breadth first along the matches of the point's observations, through attached keypoints only, at most
/// `max_transitivity` matches away from the original track (COLMAP's `Complete`). Returns the number of new observations.
pub(super) fn complete(cluster: &mut Cluster<'_>, point: usize, max_error_px: f64, max_transitivity: usize) -> usize {
    let correspondences = cluster.correspondences;
    let position = cluster.point(point).position;
    let mut attached = 0;
    // The track itself is the queue: attached slots go to its end, one layer of the search after the other.
    let mut from = 0;
    for _ in 0..max_transitivity {
        let to = cluster.point(point).slots.len();
        if from == to {
            break;
        }
        for i in from..to {
            for &other in correspondences.matches_of(cluster.point(point).slots[i]) {
                if cluster.is_free(other)
                    && cluster.views.squared_error_px2(other, position) <= max_error_px * max_error_px
                {
                    cluster.attach(point, other);
                    attached += 1;
                }
            }
        }
        from = to;
    }
    attached
}
