//! Why images are not posed: a reason for each that the stages sharpen as they learn more, and the lines of the report.

use epipole_scene::statistics::ImageErrors;
use epipole_scene::{ViewGraph, ViewImage};

use crate::component::Component;
use crate::report::{ComponentReport, ImageReport, UnregisteredReason};
use crate::stages::rotation::Rotations;

/// Why each image of the graph is not posed, as far as is known; `None` once it is.
pub(crate) struct Reasons(Vec<Option<UnregisteredReason>>);

impl Reasons {
    pub(crate) fn of_graph(graph: &ViewGraph) -> Self {
        let mut best: Vec<Option<usize>> = vec![None; graph.images.len()];
        for pair in &graph.pairs {
            for image in [pair.image1, pair.image2] {
                best[image] = Some(best[image].unwrap_or(0).max(pair.inliers.len()));
            }
        }
        let reason = |(image, best): (&ViewImage, Option<usize>)| match best {
            _ if image.keypoints_px.is_empty() => UnregisteredReason::NoKeypoints,
            Some(best) => UnregisteredReason::WeakPairs { best },
            None => UnregisteredReason::NoPairs,
        };
        Self(graph.images.iter().zip(best).map(|i| Some(reason(i))).collect())
    }

    pub(crate) fn set(&mut self, images: impl Iterator<Item = usize>, reason: &UnregisteredReason) {
        for image in images {
            self.0[image] = Some(reason.clone());
        }
    }

    /// The images of a finished component need none.
    pub(crate) fn clear(&mut self, images: &[usize]) {
        for &image in images {
            self.0[image] = None;
        }
    }

    /// The pairs left in the graph are the usable ones.
    pub(crate) fn after_relative_poses(&mut self, graph: &ViewGraph) {
        let images = graph.pairs.iter().flat_map(|p| [p.image1, p.image2]);
        self.set(images, &UnregisteredReason::InconsistentRotations);
    }

    pub(crate) fn after_rotations(&mut self, rotations: &Rotations, min_images: usize) {
        for part in &rotations.components {
            let images = part.images.len();
            if images < min_images {
                self.set(part.images.iter().map(|&(i, _)| i), &UnregisteredReason::SmallComponent { images });
            }
        }
    }
}

/// What the report says of each image of the graph, in its order.
pub(crate) fn image_reports(
    graph: &ViewGraph,
    finished: &[(Component, ComponentReport)],
    reasons: &Reasons,
) -> Vec<ImageReport> {
    let mut reports: Vec<ImageReport> = graph
        .images
        .iter()
        .zip(&reasons.0)
        .map(|(image, reason)| ImageReport {
            id: image.id,
            name: image.name.clone(),
            component: None,
            points: 0,
            mean_reprojection_error_px: None,
            unregistered: reason.clone(),
        })
        .collect();
    for (number, (component, _)) in finished.iter().enumerate() {
        for (&image, errors) in component.graph_image.iter().zip(ImageErrors::of(&component.reconstruction)) {
            let report = &mut reports[image];
            report.component = Some(number);
            report.points = errors.observations;
            report.mean_reprojection_error_px = errors.mean_px();
        }
    }
    reports
}
