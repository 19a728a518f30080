//! Averaging one set of edges: spanning tree, then the robust phases, component by component.

use epipole_optimize::executor::block_on;
use glam::DQuat;

use super::consistency::triangle_consistency;
use super::spanning_tree::{DisjointSets, compose, maximum_spanning_forest};
use super::{Edge, Options, robust};
use crate::event::{Observer, Silent, breath};

/// The rotations (`cam_from_world`) that agree best with the edges, robustly; `None` for images without edges.
///
/// Every connected part of the graph has its own world frame, in which its first image of the tree stands at identity.
///
/// # Errors
/// An edge that names an image out of range, joins an image with itself or has a rotation or weight that is not finite
/// (or a weight that is not positive), and a linear solve that fails; both as text.
pub fn average(num_images: usize, edges: &[Edge], options: &Options) -> Result<Vec<Option<DQuat>>, String> {
    block_on(average_async(num_images, edges, options, &mut Silent))
}

/// [`average`] for a host that may not block.
pub(super) async fn average_async(
    num_images: usize,
    edges: &[Edge],
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Vec<Option<DQuat>>, String> {
    check(num_images, edges)?;
    let mut tree_weights: Vec<f64> = edges.iter().map(|e| e.weight).collect();
    if options.triangle_consistency {
        let trust = triangle_consistency(num_images, edges, options.irls_sigma_deg.to_radians());
        tree_weights.iter_mut().zip(&trust).for_each(|(w, t)| *w *= t);
    }
    let heaviest = edges.iter().map(|e| e.weight).fold(f64::MIN_POSITIVE, f64::max);
    breath(observer).await;
    let tree = maximum_spanning_forest(num_images, edges, &tree_weights);

    let mut sets = DisjointSets::new(num_images);
    for edge in edges {
        sets.join(edge.i, edge.j);
    }
    let mut members = vec![Vec::new(); num_images];
    for image in 0..num_images {
        members[sets.find(image)].push(image);
    }
    let mut edges_of = vec![Vec::new(); num_images];
    for (e, edge) in edges.iter().enumerate() {
        edges_of[sets.find(edge.i)].push(e);
    }

    let mut rotations = vec![None; num_images];
    let mut local = vec![0; num_images];
    for (images, edge_indices) in members.iter().zip(&edges_of).filter(|(images, _)| images.len() >= 2) {
        for (k, &image) in images.iter().enumerate() {
            local[image] = k;
        }
        let start = compose(num_images, edges, &tree, images[0]);
        let mut part: Vec<DQuat> = images.iter().map(|&i| start[i].unwrap_or(DQuat::IDENTITY)).collect();
        let local_edge = |&e: &usize| Edge { i: local[edges[e].i], j: local[edges[e].j], ..edges[e] };
        let part_edges: Vec<Edge> = edge_indices.iter().map(local_edge).collect();
        let prior = |e: &Edge| (e.weight / heaviest).powf(options.inlier_weight_exponent);
        let prior: Vec<f64> = part_edges.iter().map(prior).collect();
        robust::refine(&part_edges, &prior, &mut part, options, observer).await?;
        for (&image, rotation) in images.iter().zip(part) {
            rotations[image] = Some(rotation);
        }
    }
    Ok(rotations)
}

fn check(num_images: usize, edges: &[Edge]) -> Result<(), String> {
    for (index, e) in edges.iter().enumerate() {
        let sound = e.i < num_images && e.j < num_images && e.i != e.j;
        let finite = e.j_from_i.is_finite() && e.weight.is_finite() && e.weight > 0.0;
        if !(sound && finite && (e.j_from_i.length() - 1.0).abs() < 1e-6) {
            return Err(format!("edge {index} ({e:?}) is not a finite rotation between two of {num_images} images"));
        }
    }
    Ok(())
}
