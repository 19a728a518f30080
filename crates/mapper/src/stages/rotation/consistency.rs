//! How well each edge closes its triangles: what tells a good edge from a bad one before any rotation is known.

use glam::DQuat;

use super::Edge;
use crate::parallel;

/// Triangles looked at per edge. The share converges long before this; dense graphs have hundreds per edge.
const MAX_TRIANGLES: usize = 64;

/// The trust in every edge, in (0, 1): the share of its triangles that close, each counted by a Geman–McClure weight
/// with scale `sigma_rad`, shrunk towards ½ by one good and one bad triangle so that an edge in few triangles is
/// neither trusted nor condemned.
pub(super) fn triangle_consistency(num_images: usize, edges: &[Edge], sigma_rad: f64) -> Vec<f64> {
    let mut neighbours: Vec<Vec<(usize, usize)>> = vec![Vec::new(); num_images];
    for (e, edge) in edges.iter().enumerate() {
        neighbours[edge.i].push((edge.j, e));
        neighbours[edge.j].push((edge.i, e));
    }
    for list in &mut neighbours {
        list.sort_unstable();
    }
    parallel::map(edges, |_, edge| {
        let common = common_neighbours(&neighbours[edge.i], &neighbours[edge.j]);
        let stride = common.len().div_ceil(MAX_TRIANGLES).max(1);
        let (mut good, mut total) = (1.0, 2.0);
        for &(via_i, via_j) in common.iter().step_by(stride) {
            let k_from_i = leaving(&edges[via_i], edge.i);
            let k_from_j = leaving(&edges[via_j], edge.j);
            let closing = k_from_j.conjugate() * k_from_i * edge.j_from_i.conjugate();
            let angle = 2.0 * closing.w.abs().min(1.0).acos();
            good += (1.0 + (angle / sigma_rad).powi(2)).powi(-2);
            total += 1.0;
        }
        good / total
    })
}

/// The edge's rotation read from the given end to the other.
fn leaving(edge: &Edge, from: usize) -> DQuat {
    if edge.i == from { edge.j_from_i } else { edge.j_from_i.conjugate() }
}

/// Pairs of edges to the vertices that occur in both sorted lists.
fn common_neighbours(a: &[(usize, usize)], b: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let (mut x, mut y) = (0, 0);
    let mut common = Vec::new();
    while x < a.len() && y < b.len() {
        match a[x].0.cmp(&b[y].0) {
            std::cmp::Ordering::Less => x += 1,
            std::cmp::Ordering::Greater => y += 1,
            std::cmp::Ordering::Equal => {
                common.push((a[x].1, b[y].1));
                x += 1;
                y += 1;
            }
        }
    }
    common
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wrong_edge_has_the_lowest_trust() {
        let rotations: Vec<DQuat> = (0..6).map(|i| DQuat::from_rotation_y(0.4 * i as f64)).collect();
        let mut edges = Vec::new();
        for i in 0..6 {
            for j in i + 1..6 {
                let j_from_i = rotations[j] * rotations[i].conjugate();
                edges.push(Edge { i, j, j_from_i, weight: 1.0 });
            }
        }
        edges[7].j_from_i *= DQuat::from_rotation_x(0.8);
        let trust = triangle_consistency(6, &edges, 0.1);
        assert!(trust[7] < 0.3);
        for (e, &t) in trust.iter().enumerate().filter(|&(e, _)| e != 7) {
            assert!(t > 0.6, "edge {e}: {t}");
        }
    }

    #[test]
    fn an_edge_without_triangles_stands_in_the_middle() {
        let edge = Edge { i: 0, j: 1, j_from_i: DQuat::IDENTITY, weight: 1.0 };
        assert_eq!(triangle_consistency(2, &[edge], 0.1), [0.5]);
    }
}
