//! What the page asks about one image, pair or point.

use epipole_scene::{Observation, Point, Reconstruction, ViewGraph};
use serde::Serialize;

/// x, y of every keypoint.
pub(crate) fn keypoints(points: &[glam::DVec2]) -> Vec<f32> {
    points.iter().flat_map(|p| [p.x as f32, p.y as f32]).collect()
}

/// Reprojection error of every keypoint of an image, px; −1 where it observes no point.
pub(crate) fn residuals(reconstruction: &Reconstruction, image: usize) -> Vec<f32> {
    let mut out = vec![-1.0; reconstruction.images[image].keypoints_px.len()];
    for point in &reconstruction.points {
        for &o in point.observations.iter().filter(|o| o.image as usize == image) {
            out[o.keypoint as usize] = reconstruction.reprojection_error_px(point, o) as f32;
        }
    }
    out
}

/// Verified matches of two images: x, y in the first, x, y in the second, 1 where both ends observe a point.
pub(crate) fn matches(graph: &ViewGraph, image: usize, other: usize) -> Vec<f32> {
    let (low, high) = (image.min(other), image.max(other));
    let Some(pair) = graph.pairs.iter().find(|pair| pair.image1 == low && pair.image2 == high) else {
        return Vec::new();
    };
    let keypoint = |image: usize, k: u32| graph.images[image].keypoints_px.get(k as usize).copied().unwrap_or_default();
    pair.inliers
        .iter()
        .flat_map(|&[k1, k2]| {
            let (a, b) = (keypoint(low, k1), keypoint(high, k2));
            let (a, b) = if image == low { (a, b) } else { (b, a) };
            [a.x as f32, a.y as f32, b.x as f32, b.y as f32, 1.0]
        })
        .collect()
}

/// The points of a model that two of its images see, like [`matches`].
pub(crate) fn common_points(model: &Reconstruction, image: usize, other: usize) -> Vec<f32> {
    let keypoint = |o: &Observation| model.images[o.image as usize].keypoints_px[o.keypoint as usize];
    let seen_by =
        |point: &Point, image: usize| point.observations.iter().find(|o| o.image as usize == image).map(keypoint);
    model
        .points
        .iter()
        .filter_map(|point| seen_by(point, image).zip(seen_by(point, other)))
        .flat_map(|(a, b)| [a.x as f32, a.y as f32, b.x as f32, b.y as f32, 1.0])
        .collect()
}

/// A point and who sees it.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Track {
    position: [f64; 3],
    error_px: f64,
    /// Largest angle between two of its rays, degrees.
    angle_deg: f64,
    observations: Vec<Seen>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Seen {
    image: usize,
    keypoint: u32,
    error_px: f64,
    /// The keypoint, px.
    observed: [f64; 2],
    /// Where the model puts the point, px; absent for a point that this camera cannot see.
    projected: Option<[f64; 2]>,
}

pub(crate) fn track(reconstruction: &Reconstruction, point: usize, image_of: impl Fn(usize) -> usize) -> Option<Track> {
    let point = reconstruction.points.get(point)?;
    let rays: Vec<glam::DVec3> = point
        .observations
        .iter()
        .map(|o| (point.position - reconstruction.images[o.image as usize].cam_from_world.center()).normalize_or_zero())
        .collect();
    let mut least = 1.0f64;
    for (k, a) in rays.iter().enumerate() {
        for b in &rays[k + 1..] {
            least = least.min(a.dot(*b));
        }
    }
    let observations = point.observations.iter().map(|&o| {
        let image = &reconstruction.images[o.image as usize];
        let in_cam = image.cam_from_world.transform_point(point.position);
        Seen {
            image: image_of(o.image as usize),
            keypoint: o.keypoint,
            error_px: reconstruction.reprojection_error_px(point, o),
            observed: image.keypoints_px[o.keypoint as usize].to_array(),
            projected: reconstruction.cameras[image.camera].project(in_cam).map(|px| px.to_array()),
        }
    });
    Some(Track {
        position: point.position.to_array(),
        error_px: point.error_px,
        angle_deg: least.clamp(-1.0, 1.0).acos().to_degrees(),
        observations: observations.collect(),
    })
}
