//! The start of rotation averaging: rotations composed along a maximum spanning tree.

use glam::DQuat;

use super::Edge;

/// The edges of a maximum spanning forest, heaviest first; ties go to the earlier edge.
pub(super) fn maximum_spanning_forest(num_images: usize, edges: &[Edge], weights: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
    let mut sets = DisjointSets::new(num_images);
    order.retain(|&e| sets.join(edges[e].i, edges[e].j));
    order
}

/// Rotations that satisfy every edge of the tree, the root at identity; `None` where the tree does not reach.
pub(super) fn compose(num_images: usize, edges: &[Edge], tree: &[usize], root: usize) -> Vec<Option<DQuat>> {
    let mut incident = vec![Vec::new(); num_images];
    for &e in tree {
        incident[edges[e].i].push(e);
        incident[edges[e].j].push(e);
    }
    let mut rotations = vec![None; num_images];
    let mut queue = std::collections::VecDeque::from([(root, DQuat::IDENTITY)]);
    rotations[root] = Some(DQuat::IDENTITY);
    while let Some((image, rotation)) = queue.pop_front() {
        for &e in &incident[image] {
            let Edge { i, j, j_from_i, .. } = edges[e];
            let (other, other_from_image) = if i == image { (j, j_from_i) } else { (i, j_from_i.conjugate()) };
            if rotations[other].is_none() {
                let composed = (other_from_image * rotation).normalize();
                rotations[other] = Some(composed);
                queue.push_back((other, composed));
            }
        }
    }
    rotations
}

/// Union–find with path halving; the smaller index is the root, so that labels do not depend on the order of joins.
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    pub(crate) fn find(&mut self, element: usize) -> usize {
        let mut at = element;
        while self.0[at] as usize != at {
            self.0[at] = self.0[self.0[at] as usize];
            at = self.0[at] as usize;
        }
        at
    }

    /// Joins the sets of two elements; whether they were different.
    pub(crate) fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
        a != b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_takes_the_heaviest_edges() {
        let turn = DQuat::from_rotation_z(0.3);
        let edge = |i, j| Edge { i, j, j_from_i: turn, weight: 1.0 };
        let edges = [edge(0, 1), edge(1, 2), edge(0, 2), edge(3, 4)];
        let tree = maximum_spanning_forest(5, &edges, &[1.0, 5.0, 2.0, 9.0]);
        assert_eq!(tree, [3, 1, 2]);
        let rotations = compose(5, &edges, &tree, 0);
        assert!(rotations[1].unwrap().angle_between(DQuat::IDENTITY) < 1e-7);
        assert!(rotations[2].unwrap().angle_between(turn) < 1e-7);
        assert!(rotations[3].is_none());
    }
}
