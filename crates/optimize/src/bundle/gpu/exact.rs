//! Shared cameras whose block of the preconditioner is exact, and where the sums over points that it takes lie.

use super::chunk::Chunk;
use crate::bundle::problem::Problem;
use crate::reduced::coarse::MAX_GROUPS;

/// As in `precondition_group.wgsl`: spans of points of a chunk at most.
const MAX_SPANS: usize = 256;
/// Points that one workgroup handles at a time.
const POINT_GROUP: usize = 64;

/// The cameras that several images share and whose parameters may move; none where there are so many that a pass over
/// the points for each would cost more than it saves.
pub(super) fn exact_cameras(problem: &Problem) -> Vec<u32> {
    let mut images = vec![0usize; problem.cameras.len()];
    problem.image_camera.iter().for_each(|&c| images[c as usize] += 1);
    let moves = |c: usize| {
        let params = problem.cameras[c].params.len();
        problem.refine_params[c].iter().take(params).any(|&refine| refine)
    };
    let shared: Vec<u32> =
        (0..images.len()).filter(|&c| images[c] > 1 && moves(c) && !problem.fixed_points).map(|c| c as u32).collect();
    if shared.len() > MAX_GROUPS { Vec::new() } else { shared }
}

/// Sums of one camera over the points of a chunk.
pub(super) fn spans(chunk: &Chunk) -> usize {
    chunk.points.len().div_ceil(POINT_GROUP).clamp(1, MAX_SPANS)
}
