//! Photographs: which points each image sees, as noisy keypoints among distractors in no particular order.

use epipole_geometry::camera::Camera;
use glam::{DVec2, DVec3};

use super::cameras::Cameras;
use super::layout::Layout;
use super::options::Options;
use super::random::{Random, Stream};

/// A surface seen at a flatter angle than 70° from its normal yields no keypoint.
const MIN_FACING_COSINE: f64 = 0.342;
/// Keypoints keep this distance from the image border, px.
const BORDER_PX: f64 = 2.0;
/// Nothing is photographed closer than this, metres.
const MIN_DISTANCE: f64 = 0.3;

/// One keypoint and the truth about it.
#[derive(Clone, Copy)]
pub(crate) struct Keypoint {
    /// As detected: noisy, and rounded to the database's f32.
    pub(crate) pixel_px: DVec2,
    /// The noise-free ray in the camera frame.
    pub(crate) ray: DVec3,
    /// The world point; `None` for a distractor.
    pub(crate) point: Option<u32>,
    /// True depth along the optical axis, metres; NaN for a distractor.
    pub(crate) depth: f64,
}

/// The keypoints of every image.
pub(crate) fn photograph(options: &Options, layout: &Layout, cameras: &Cameras) -> Vec<Vec<Keypoint>> {
    let mut random = Random::new(options.seed, Stream::Keypoints);
    let image = |i: usize| photograph_one(options, layout, &cameras.truth[cameras.of_image[i]], i, &mut random);
    (0..options.num_images).map(image).collect()
}

fn photograph_one(
    options: &Options,
    layout: &Layout,
    camera: &Camera,
    image: usize,
    random: &mut Random,
) -> Vec<Keypoint> {
    let cam_from_world = layout.cam_from_world[image];
    let center = cam_from_world.center();
    let mut keypoints = Vec::new();
    for (p, point) in layout.points.iter().enumerate() {
        let to_camera = center - point.position;
        let distance = to_camera.length();
        if !(MIN_DISTANCE..layout.max_distance).contains(&distance)
            || to_camera.dot(point.normal) < MIN_FACING_COSINE * distance
        {
            continue;
        }
        let in_cam = cam_from_world.transform_point(point.position);
        let Some(pixel) = visible(camera, in_cam) else { continue };
        if !random.chance(options.detection_rate * point.popularity) {
            continue;
        }
        let noise = DVec2::new(random.gaussian(), random.gaussian()) * options.noise_px;
        keypoints.push(Keypoint {
            pixel_px: as_stored(pixel + noise),
            ray: in_cam.normalize(),
            point: Some(p as u32),
            depth: in_cam.z,
        });
    }
    let wanted = (keypoints.len() as f64 * options.distractor_share).round() as usize;
    let seen = keypoints.len();
    for _ in 0..wanted {
        // Near a real keypoint's ray: texture attracts detections.
        let near = keypoints[random.index(seen)].ray;
        let ray = (near + random.gaussian3(0.1)).normalize_or(near);
        let Some(pixel) = visible(camera, ray) else { continue };
        keypoints.push(Keypoint { pixel_px: as_stored(pixel), ray, point: None, depth: f64::NAN });
    }
    random.shuffle(&mut keypoints);
    keypoints
}

fn visible(camera: &Camera, in_cam: DVec3) -> Option<DVec2> {
    let pixel = camera.project(in_cam)?;
    let (width, height) = (camera.width_px as f64, camera.height_px as f64);
    let inside =
        (BORDER_PX..width - BORDER_PX).contains(&pixel.x) && (BORDER_PX..height - BORDER_PX).contains(&pixel.y);
    // Past a model's turning point a ray far outside the view can fold back into the image.
    let folded = in_cam.z > 0.0 && in_cam.truncate().length() > 4.0 * in_cam.z;
    (inside && !folded).then_some(pixel)
}

/// Databases hold keypoints as f32.
fn as_stored(pixel_px: DVec2) -> DVec2 {
    pixel_px.as_vec2().as_dvec2()
}
