//! Global positioning: all camera centres and points at once from rays and rotations, then the filters after it.
//!
//! Convex start, then variable projection with Huber 0.01 (global-positioning.md §5); filters after GLOMAP with the
//! angular bound that global-positioning.md §3 found better.

use epipole_geometry::Rigid3;
use epipole_optimize::{Engine, positioning};
use epipole_scene::{Observation, Point, ViewGraph, filter, normalize};
use serde::{Deserialize, Serialize};

use super::refine::Forward;
use super::tracks::Tracks;
use crate::component::Component;
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage};
use crate::parallel;

/// Global positioning and its filters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Huber threshold of the ray residual, roughly radians (global-positioning.md §4: 0.1 treats mismatches as inliers).
    pub huber: f64,
    /// Weight of images whose focal length is a guess (GLOMAP: 0.5).
    pub guessed_focal_weight: f64,
    /// Relative decrease of the cost that ends the solve.
    pub relative_decrease_tolerance: f64,
    /// Observations farther from their ray are dropped, degrees (global-positioning.md §5: 2).
    pub max_angular_error_deg: f64,
    /// Points all of whose rays are closer than this are dropped, degrees (GLOMAP: 1).
    pub min_triangulation_angle_deg: f64,
    /// Bound of the reprojection error on the plane z = 1 (GLOMAP: ten times the final one).
    pub max_normalized_error: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            huber: 0.01,
            guessed_focal_weight: 0.5,
            relative_decrease_tolerance: 1e-3,
            max_angular_error_deg: 2.0,
            min_triangulation_angle_deg: 1.0,
            max_normalized_error: 1e-1,
        }
    }
}

/// What global positioning found.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The solver's report.
    pub report: positioning::Report,
    /// Observations that took part.
    pub observations: usize,
    /// View-graph images in groups that no track joins to the component: taken out, to be reconstructed by themselves.
    pub left_over: Vec<Vec<usize>>,
    /// View-graph images without a usable track: taken out.
    pub without_tracks: Vec<usize>,
}

/// Poses the component's images and fills in its points from the tracks.
///
/// Images that the tracks do not join to the largest group are taken out of the component, because their position
/// relative to it is unknown.
pub async fn run(
    graph: &ViewGraph,
    tracks: &Tracks,
    component: &mut Component,
    options: &Options,
    engine: &mut Engine,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    let image_of = component.image_of_graph(graph.images.len());
    let rays: Vec<Vec<Option<glam::DVec3>>> = parallel::map(&component.reconstruction.images, |_, image| {
        let camera = &component.reconstruction.cameras[image.camera];
        let world_from_cam = image.cam_from_world.rotation.conjugate();
        image.keypoints_px.iter().map(|&px| camera.ray_from_pixel(px).map(|ray| world_from_cam * ray)).collect()
    });
    let mut problem = positioning::Problem {
        centers: vec![glam::DVec3::ZERO; component.reconstruction.images.len()],
        points: Vec::new(),
        image_weight: component
            .reconstruction
            .images
            .iter()
            .map(|i| match component.reconstruction.cameras[i.camera].has_prior_focal {
                true => 1.0,
                false => options.guessed_focal_weight,
            })
            .collect(),
        track_start: vec![0],
        observation_image: Vec::new(),
        observation_ray: Vec::new(),
        pinned_scale: None,
    };
    let mut points = Vec::new();
    for track in 0..tracks.len() {
        let mut observations = Vec::new();
        for o in tracks.observations_of(track) {
            let Some(image) = image_of[o.image as usize] else { continue };
            let Some(ray) = rays[image as usize][o.keypoint as usize] else { continue };
            observations.push(Observation { image, keypoint: o.keypoint });
            problem.observation_image.push(image);
            problem.observation_ray.push(ray);
        }
        problem.track_start.push(problem.observation_image.len() as u32);
        problem.points.push(glam::DVec3::ZERO);
        points.push(Point {
            id: points.len() as u64 + 1,
            position: glam::DVec3::ZERO,
            rgb: [0; 3],
            error_px: -1.0,
            observations,
        });
    }
    drop(rays);
    let mut solver = positioning::Options { huber: options.huber, ..positioning::Options::default() };
    solver.lm.relative_decrease_tolerance = options.relative_decrease_tolerance;
    let mut forward = Forward { stage: Stage::Position, observer };
    let report = engine.position(&mut problem, &solver, &mut forward).await?;
    for (image, &center) in component.reconstruction.images.iter_mut().zip(&problem.centers) {
        image.cam_from_world = Rigid3::from_rotation_and_center(image.cam_from_world.rotation, center);
    }
    for (point, &position) in points.iter_mut().zip(&problem.points) {
        point.position = position;
    }
    component.reconstruction.points = points;
    for warning in &report.warnings {
        observer.event(&Event::Warning { message: format!("global positioning: {warning}") });
    }
    let graph_images = |group: &Vec<u32>| group.iter().map(|&i| component.graph_image[i as usize]).collect();
    let left_over = report.components.iter().skip(1).map(graph_images).collect();
    let without_tracks = graph_images(&report.unplaced_images);
    let mut placed = vec![false; component.graph_image.len()];
    for &image in report.components.first().into_iter().flatten() {
        placed[image as usize] = true;
    }
    component.retain_images(&placed);
    let reconstruction = &mut component.reconstruction;
    filter::filter_angular(reconstruction, options.max_angular_error_deg.to_radians());
    filter::filter_triangulation_angle(reconstruction, options.min_triangulation_angle_deg.to_radians());
    filter::filter_normalized(reconstruction, options.max_normalized_error);
    normalize::normalize(reconstruction);
    Ok(Summary { observations: report.observations, report, left_over, without_tracks })
}
