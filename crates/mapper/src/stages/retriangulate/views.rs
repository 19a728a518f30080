//! The posed images as this stage needs them: from a slot of the correspondence graph to its ray and its pixel error.

use epipole_geometry::camera::{Camera, CameraFamily, project_with_derivatives};
use epipole_geometry::triangulation::View;
use epipole_scene::Observation;
use glam::{DMat3, DVec2, DVec3};

use crate::component::Component;
use crate::correspondences::CorrespondenceGraph;

/// A posed image with a credible camera.
struct PosedImage<'a> {
    /// Index into the component's images.
    image: u32,
    /// World to camera.
    rotation: DMat3,
    /// World to camera.
    translation: DVec3,
    /// Camera centre in the world.
    center: DVec3,
    camera: &'a Camera,
    keypoints_px: &'a [DVec2],
}

/// The reprojection error of one observation, linearised by the point's position.
pub(super) struct LinearError {
    /// Projection minus keypoint, px.
    pub(super) error_px: DVec2,
    /// Derivatives of its two coordinates by the position in the world, px per world unit.
    pub(super) rows: [DVec3; 2],
}

/// All posed images, found by slot.
pub(super) struct Views<'a> {
    correspondences: &'a CorrespondenceGraph,
    of_graph_image: Vec<Option<PosedImage<'a>>>,
}

impl<'a> Views<'a> {
    /// Images without a finite pose are left out, and with `skip_bogus_cameras` those of a bogus camera too, so that
    /// nothing is triangulated from them.
    pub(super) fn new(
        correspondences: &'a CorrespondenceGraph,
        component: &'a Component,
        skip_bogus_cameras: bool,
    ) -> Self {
        let num_images = component.graph_image.iter().max().map_or(0, |&last| last + 1);
        let mut of_graph_image: Vec<Option<PosedImage<'a>>> = (0..num_images).map(|_| None).collect();
        let cameras = &component.reconstruction.cameras;
        let bogus: Vec<bool> = cameras.iter().map(|camera| skip_bogus_cameras && camera.has_bogus_params()).collect();
        let images = component.reconstruction.images.iter().zip(&component.graph_image);
        for (i, (image, &graph_image)) in images.enumerate() {
            if bogus[image.camera] || !image.cam_from_world.is_finite() {
                continue;
            }
            of_graph_image[graph_image] = Some(PosedImage {
                image: i as u32,
                rotation: image.cam_from_world.rotation_matrix(),
                translation: image.cam_from_world.translation,
                center: image.cam_from_world.center(),
                camera: &cameras[image.camera],
                keypoints_px: &image.keypoints_px,
            });
        }
        Self { correspondences, of_graph_image }
    }

    fn of(&self, slot: u32) -> Option<(&PosedImage<'a>, DVec2)> {
        let posed = self.of_graph_image.get(self.correspondences.image_of(slot))?.as_ref()?;
        Some((posed, *posed.keypoints_px.get(self.correspondences.keypoint_of(slot) as usize)?))
    }

    /// Whether an image of the view graph can take part.
    pub(super) fn has_image(&self, graph_image: usize) -> bool {
        self.of_graph_image.get(graph_image).is_some_and(Option::is_some)
    }

    /// Where the slot looks, or `None` where its image takes no part or the camera model has no ray for the keypoint.
    pub(super) fn view(&self, slot: u32) -> Option<View> {
        let (posed, px) = self.of(slot)?;
        let ray_in_world = posed.rotation.transpose() * posed.camera.ray_from_pixel(px)?;
        ray_in_world.is_finite().then_some(View { center: posed.center, ray_in_world })
    }

    /// Squared reprojection error, px²; infinite where the point does not project.
    pub(super) fn squared_error_px2(&self, slot: u32, position: DVec3) -> f64 {
        let Some((posed, px)) = self.of(slot) else { return f64::INFINITY };
        let in_cam = posed.rotation * position + posed.translation;
        if posed.camera.model.family() == CameraFamily::Spherical {
            return posed.camera.reprojection_error_px(in_cam, px).powi(2);
        }
        match posed.camera.project(in_cam) {
            // NaN (a keypoint that is not a number) must not pass for a small error.
            Some(projected) => Some((projected - px).length_squared()).filter(|e| !e.is_nan()).unwrap_or(f64::INFINITY),
            None => f64::INFINITY,
        }
    }

    /// The reprojection error with its derivatives by the position; `None` where the point does not project.
    pub(super) fn linear_error(&self, slot: u32, position: DVec3) -> Option<LinearError> {
        let (posed, px) = self.of(slot)?;
        let in_cam = posed.rotation * position + posed.translation;
        let projection = project_with_derivatives(posed.camera.model, &posed.camera.params, in_cam.to_array())?;
        let world_from_cam = posed.rotation.transpose();
        Some(LinearError {
            error_px: DVec2::from_array(projection.pixel) - px,
            rows: projection.d_point.map(|row| world_from_cam * DVec3::from_array(row)),
        })
    }

    /// The slot as an observation of the component's reconstruction.
    pub(super) fn observation(&self, slot: u32) -> Option<Observation> {
        let (posed, _) = self.of(slot)?;
        Some(Observation { image: posed.image, keypoint: self.correspondences.keypoint_of(slot) })
    }
}
