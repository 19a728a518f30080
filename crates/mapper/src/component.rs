//! One connected part of the view graph while it is being reconstructed.

use epipole_scene::{Image, Reconstruction, ViewGraph, normalize};
use glam::DQuat;

use epipole_geometry::Rigid3;

use crate::metric::{self, Metric};

/// A reconstruction together with where its images stand in the view graph.
#[derive(Clone, Debug, Default)]
pub struct Component {
    /// The reconstruction; `reconstruction.cameras` are the view graph's cameras, all of them, in the same order.
    pub reconstruction: Reconstruction,
    /// For every image of the reconstruction, its index in [`ViewGraph::images`]; ascending.
    pub graph_image: Vec<usize>,
    /// What is known of its scale.
    pub metric: Metric,
}

impl Component {
    /// A component of the given images (ascending) with their rotations, centres at the origin and no points.
    pub fn new(graph: &ViewGraph, images_with_rotation: &[(usize, DQuat)], metric: &metric::Options) -> Self {
        let images = images_with_rotation.iter().map(|&(index, rotation)| {
            let view = &graph.images[index];
            Image {
                id: view.id,
                name: view.name.clone(),
                camera: view.camera,
                cam_from_world: Rigid3::new(rotation, glam::DVec3::ZERO),
                keypoints_px: view.keypoints_px.clone(),
                depths: view.depths.clone(),
            }
        });
        let images: Vec<Image> = images.collect();
        Self {
            metric: Metric::new(metric, &images),
            reconstruction: Reconstruction { cameras: graph.cameras.clone(), images, ..Reconstruction::default() },
            graph_image: images_with_rotation.iter().map(|&(index, _)| index).collect(),
        }
    }

    /// For every image of the view graph, its index in this component, or `None`.
    pub fn image_of_graph(&self, num_graph_images: usize) -> Vec<Option<u32>> {
        let mut of = vec![None; num_graph_images];
        for (i, &g) in self.graph_image.iter().enumerate() {
            of[g] = Some(i as u32);
        }
        of
    }

    /// Brings coordinates to order one; where they are metres only the origin moves.
    pub fn normalize(&mut self) {
        if self.metric.is_metric() {
            normalize::center(&mut self.reconstruction);
        } else {
            normalize::normalize(&mut self.reconstruction);
        }
    }

    /// Takes images out, with their observations and the points that fewer than two observations are left of.
    /// Returns the view-graph indices of what was taken, ascending.
    pub fn retain_images(&mut self, keep: &[bool]) -> Vec<usize> {
        let mut new_index = vec![None; keep.len()];
        let mut kept = 0;
        for (index, &keep) in new_index.iter_mut().zip(keep) {
            if keep {
                *index = Some(kept);
                kept += 1;
            }
        }
        let mut position = 0..;
        self.reconstruction.images.retain(|_| position.next().is_some_and(|i| keep[i]));
        self.metric.retain_images(keep);
        let old = std::mem::take(&mut self.graph_image);
        let (stay, taken): (Vec<_>, Vec<_>) = old.into_iter().enumerate().partition(|&(i, _)| keep[i]);
        self.graph_image = stay.into_iter().map(|(_, g)| g).collect();
        for point in &mut self.reconstruction.points {
            point.observations.retain_mut(|o| match new_index[o.image as usize] {
                Some(image) => {
                    o.image = image;
                    true
                }
                None => false,
            });
        }
        self.reconstruction.points.retain(|p| p.observations.len() >= 2);
        taken.into_iter().map(|(_, g)| g).collect()
    }
}
