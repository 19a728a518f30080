//! The cameras as they are, and as the database believes them to be.

use epipole_geometry::camera::{Camera, CameraFamily, CameraModel};

use super::options::{FocalKnowledge, Options};
use super::random::{Random, Stream};

/// Cameras in pairs of truth and belief, and which image uses which.
pub(crate) struct Cameras {
    pub(crate) truth: Vec<Camera>,
    pub(crate) stored: Vec<Camera>,
    pub(crate) of_image: Vec<usize>,
}

/// `zoom` holds one factor an image; a shared camera takes its first image's.
pub(crate) fn build(options: &Options, zoom: &[f64]) -> Cameras {
    let mut random = Random::new(options.seed, Stream::Cameras);
    let n = options.num_images;
    let count = if options.num_cameras == 0 { n } else { options.num_cameras.min(n) };
    let larger_side = options.image_size_px[0].max(options.image_size_px[1]) as f64;
    let (mut truth, mut stored) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for c in 0..count {
        let model = options.models[c % options.models.len()];
        // Cameras of one make still differ by a few per cent.
        let variation = if count == 1 { 1.0 } else { random.uniform(0.96, 1.04) };
        let focal_px = options.focal_ratio * larger_side * zoom[c] * variation;
        truth.push(camera(c, model, options.image_size_px, focal_px, true, true));
        stored.push(match options.focal {
            FocalKnowledge::Exact => truth[c].clone(),
            FocalKnowledge::Exif { relative_error } => {
                let believed = focal_px * (1.0 + relative_error * random.gaussian()).max(0.1);
                camera(c, model, options.image_size_px, believed, false, true)
            }
            FocalKnowledge::Guessed => {
                let [width_px, height_px] = options.image_size_px;
                Camera::with_default_params(c as u32 + 1, model, width_px, height_px)
            }
        });
    }
    Cameras { truth, stored, of_image: (0..n).map(|i| if count == 0 { 0 } else { i % count }).collect() }
}

/// A camera with COLMAP's neutral parameters, or with some distortion.
fn camera(
    index: usize,
    model: CameraModel,
    [width_px, height_px]: [u64; 2],
    focal_px: f64,
    distorted: bool,
    has_prior_focal: bool,
) -> Camera {
    let mut camera = Camera::with_focal(index as u32 + 1, model, width_px, height_px, focal_px);
    camera.has_prior_focal = has_prior_focal;
    if distorted {
        for (&i, &value) in model.extra_params().iter().zip(distortion(model)) {
            camera.params[i] = value;
        }
    }
    camera
}

/// Moderate distortion: a few dozen pixels in the corners of a photograph.
fn distortion(model: CameraModel) -> &'static [f64] {
    match model {
        CameraModel::SimplePinhole
        | CameraModel::Pinhole
        | CameraModel::SimpleFisheye
        | CameraModel::Fisheye
        | CameraModel::Equirectangular => &[],
        CameraModel::SimpleRadial => &[-0.05],
        CameraModel::Radial => &[-0.06, 0.02],
        CameraModel::OpenCv => &[-0.06, 0.02, 5e-4, -3e-4],
        CameraModel::OpenCvFisheye => &[0.01, -0.005, 0.001, -0.0005],
        CameraModel::FullOpenCv => &[-0.06, 0.02, 5e-4, -3e-4, 0.001, 0.005, -0.001, 0.0],
        CameraModel::Fov => &[0.5],
        CameraModel::SimpleRadialFisheye => &[0.02],
        CameraModel::RadialFisheye => &[0.02, -0.005],
        CameraModel::ThinPrismFisheye => &[0.01, -0.005, 5e-4, -3e-4, 0.001, 0.0, 2e-4, -2e-4],
        CameraModel::RadTanThinPrismFisheye => {
            &[0.01, -0.005, 0.001, 0.0, 0.0, 0.0, 5e-4, -3e-4, 2e-4, 0.0, -2e-4, 0.0]
        }
        CameraModel::SimpleDivision | CameraModel::Division => &[-0.05],
        CameraModel::Eucm => &[0.4, 1.05],
    }
}

/// Whether a fundamental matrix describes a pair of this camera up to its distortion (algorithms.md §3.5, groups).
pub(crate) fn is_perspective(camera: &Camera) -> bool {
    camera.model.family() == CameraFamily::Perspective
}

/// The camera's pinhole part.
pub(crate) fn without_distortion(camera: &Camera) -> Camera {
    let center_px = camera.principal_point_px();
    let focals = camera.model.focal_params();
    let focal_px = [focals.first(), focals.last()].map(|i| i.map_or(camera.mean_focal_px(), |&i| camera.params[i]));
    Camera {
        model: CameraModel::Pinhole,
        params: vec![focal_px[0], focal_px[1], center_px.x, center_px.y],
        ..camera.clone()
    }
}
