//! Global positioning: all camera centres and points at once from rays and rotations, then the filters after it.
//!
//! Convex start, then variable projection with Huber 0.01 (global-positioning.md §5); filters after GLOMAP with the
//! angular bound that global-positioning.md §3 found better.

use epipole_geometry::Rigid3;
use epipole_optimize::{Engine, positioning};
use epipole_scene::{Observation, Point, ViewGraph, filter};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::refine::Forward;
use super::tracks::Tracks;
use crate::component::Component;
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};
use crate::metric::ray_length_m;
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

/// Rays whose length a depth map gives.
struct Pins {
    wanted: bool,
    scale: Vec<f64>,
    sigma: Vec<f64>,
}

impl Pins {
    fn new(component: &Component) -> Self {
        Self { wanted: component.metric.pins_rays(), scale: Vec::new(), sigma: Vec::new() }
    }

    /// Of one observation with its ray in the world frame.
    fn push(&mut self, component: &Component, o: Observation, ray_in_world: DVec3) {
        if !self.wanted {
            return;
        }
        let image = &component.reconstruction.images[o.image as usize];
        let camera = &component.reconstruction.cameras[image.camera];
        let depth = image.depths.as_ref().and_then(|depths| depths.get(o.keypoint as usize));
        let length = depth.and_then(|depth| {
            let ray_in_cam = image.cam_from_world.rotation * ray_in_world;
            Some((ray_length_m(camera, ray_in_cam, depth)?, depth.relative_sigma))
        });
        let (scale, sigma) = length.map_or((0.0, 0.0), |(length_m, sigma)| (1.0 / length_m, sigma));
        self.scale.push(scale);
        self.sigma.push(sigma);
    }

    fn put_into(self, problem: &mut positioning::Problem) {
        if self.scale.iter().any(|&scale| scale > 0.0) {
            (problem.pinned_scale, problem.pin_sigma) = (Some(self.scale), Some(self.sigma));
        }
    }
}

/// Writes the solver's positions.
fn place(component: &mut Component, problem: &positioning::Problem) {
    for (image, &center) in component.reconstruction.images.iter_mut().zip(&problem.centers) {
        image.cam_from_world = Rigid3::from_rotation_and_center(image.cam_from_world.rotation, center);
    }
    for (point, &position) in component.reconstruction.points.iter_mut().zip(&problem.points) {
        point.position = position;
    }
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
    breath(observer).await;
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
        pin_sigma: None,
    };
    let mut pins = Pins::new(component);
    let mut points = Vec::new();
    for track in 0..tracks.len() {
        let mut observations = Vec::new();
        for o in tracks.observations_of(track) {
            let Some(image) = image_of[o.image as usize] else { continue };
            let Some(ray) = rays[image as usize][o.keypoint as usize] else { continue };
            observations.push(Observation { image, keypoint: o.keypoint });
            problem.observation_image.push(image);
            problem.observation_ray.push(ray);
            pins.push(component, observations[observations.len() - 1], ray);
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
    pins.put_into(&mut problem);
    let mut solver = positioning::Options { huber: options.huber, ..positioning::Options::default() };
    solver.lm.relative_decrease_tolerance = options.relative_decrease_tolerance;
    component.reconstruction.points = points;
    breath(observer).await;
    let mut forward = Forward { stage: Stage::Position, component, points: None, observer };
    let mut report = engine.position(&mut problem, &solver, &mut forward).await?;
    place(component, &problem);
    breath(observer).await;
    let mut doubt = component.metric.begin(&mut component.reconstruction);
    if doubt.is_some() && problem.pinned_scale.is_some() {
        // Depths that contradict the rays have bent them: once more without. What is right about them shows then.
        (problem.pinned_scale, problem.pin_sigma) = (None, None);
        let mut forward = Forward { stage: Stage::Position, component, points: None, observer };
        report = engine.position(&mut problem, &solver, &mut forward).await?;
        place(component, &problem);
        doubt = component.metric.begin(&mut component.reconstruction);
    }
    if let Some(message) = doubt {
        observer.event(&Event::Warning { message });
    }
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
    breath(observer).await;
    let reconstruction = &mut component.reconstruction;
    filter::filter_angular(reconstruction, options.max_angular_error_deg.to_radians());
    filter::filter_triangulation_angle(reconstruction, options.min_triangulation_angle_deg.to_radians());
    breath(observer).await;
    filter::filter_normalized(reconstruction, options.max_normalized_error);
    component.normalize();
    observer.snapshot(component, false);
    breath(observer).await;
    Ok(Summary { observations: report.observations, report, left_over, without_tracks })
}
