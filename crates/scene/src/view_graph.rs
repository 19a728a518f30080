//! The input of the pipeline: images with keypoints, and pairs of images with matches.

use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use glam::{DMat3, DVec2};

use crate::ImageDepths;

/// Everything a match database says, indexed densely: images, cameras and pairs are referred to by position.
#[derive(Clone, Debug, Default)]
pub struct ViewGraph {
    /// Cameras, sorted by id.
    pub cameras: Vec<Camera>,
    /// Images, sorted by id.
    pub images: Vec<ViewImage>,
    /// Pairs, sorted by (image1, image2), with `image1 < image2`.
    pub pairs: Vec<Pair>,
}

/// An image as the database knows it.
#[derive(Clone, Debug)]
pub struct ViewImage {
    /// COLMAP's image id.
    pub id: u32,
    /// File name, relative to the image folder.
    pub name: String,
    /// Index into [`ViewGraph::cameras`].
    pub camera: usize,
    /// Keypoints, px, the centre of the first pixel at (0.5, 0.5); shared with the reconstructions.
    pub keypoints_px: Arc<[DVec2]>,
    /// Depths of the keypoints, one each, if the image has a depth map.
    pub depths: Option<Arc<ImageDepths>>,
}

/// How geometric verification labelled a pair.
pub use epipole_geometry::two_view::TwoViewConfig as PairConfig;

/// Intrinsics that the two-view solver itself estimated; they, not the image's camera, explain `E` and the pose.
pub type PairCamera = Camera;

/// Two images and what matches between them.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Index of the first image.
    pub image1: usize,
    /// Index of the second image, larger than `image1`.
    pub image2: usize,
    /// COLMAP's label.
    pub config: PairConfig,
    /// Fundamental matrix, `x2ᵀ F x1 = 0` in pixels.
    pub fundamental: Option<DMat3>,
    /// Essential matrix, `ray2ᵀ E ray1 = 0`.
    pub essential: Option<DMat3>,
    /// Homography, `x2 ~ H x1` in pixels.
    pub homography: Option<DMat3>,
    /// Relative pose with unit (or zero, for a panoramic pair) translation, if the database or a stage knows it.
    pub cam2_from_cam1: Option<Rigid3>,
    /// Intrinsics estimated together with the geometry, for image 1 and image 2.
    pub solver_cameras: [Option<PairCamera>; 2],
    /// Verified matches: (keypoint in image 1, keypoint in image 2).
    pub inliers: Vec<[u32; 2]>,
    /// Raw matches before verification, if they were asked for.
    pub matches: Option<Vec<[u32; 2]>>,
    /// Number of raw matches, known even when they were not read.
    pub num_matches: usize,
}

impl Pair {
    /// A pair of which nothing is known yet: no matches, no geometry.
    pub fn unverified(image1: usize, image2: usize) -> Self {
        Self {
            image1,
            image2,
            config: PairConfig::Undefined,
            fundamental: None,
            essential: None,
            homography: None,
            cam2_from_cam1: None,
            solver_cameras: [None, None],
            inliers: Vec::new(),
            matches: None,
            num_matches: 0,
        }
    }
}
