//! What a synthetic scene looks like.

use std::str::FromStr;

use epipole_geometry::camera::CameraModel;

use super::SynthError;

/// How the cameras stand in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A ring of cameras around an object.
    Orbit,
    /// A drive along a street, looking at the houses on one side; with `loop_closure` around a block.
    Street,
    /// A grid of cameras before a nearly flat wall.
    Facade,
    /// Strangers' photos of one building: popular viewpoints, many focal lengths, Pareto track lengths.
    Internet,
}

impl FromStr for Kind {
    type Err = SynthError;

    fn from_str(text: &str) -> Result<Self, SynthError> {
        match text {
            "orbit" => Ok(Self::Orbit),
            "street" => Ok(Self::Street),
            "facade" => Ok(Self::Facade),
            "internet" => Ok(Self::Internet),
            _ => Err(SynthError::InvalidOption {
                name: "kind",
                value: text.into(),
                expected: "write orbit, street, facade or internet",
            }),
        }
    }
}

/// What the database knows of the focal lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FocalKnowledge {
    /// The true intrinsics, marked as known.
    Exact,
    /// The focal length off by a normal relative error and no distortion, marked as known: what EXIF gives.
    Exif {
        /// Standard deviation of the relative error.
        relative_error: f64,
    },
    /// COLMAP's guess of 1.2 times the larger image side, no distortion, marked as guessed; the pairs carry a
    /// fundamental matrix only.
    Guessed,
}

/// Which relative poses stand in the database.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StoredPoses {
    /// None: what COLMAP writes unless asked.
    Absent,
    /// The least-squares estimate from the pair's noisy matches, so that errors correlate as in real data.
    Estimated,
    /// The truth with independent errors.
    Perturbed {
        /// Standard deviation of the rotation's angle per axis, degrees.
        rotation_deg: f64,
        /// Standard deviation of the translation direction per axis, degrees.
        direction_deg: f64,
    },
}

/// Everything that decides a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How the cameras stand.
    pub kind: Kind,
    /// Number of images.
    pub num_images: usize,
    /// Points in the world; each image sees a part of them.
    pub num_points: usize,
    /// Everything random follows from it.
    pub seed: u64,
    /// Width and height of the images, px.
    pub image_size_px: [u64; 2],
    /// Standard deviation of a keypoint's coordinate, px.
    pub noise_px: f64,
    /// Share of a pair's verified matches that are wrong yet agree with its epipolar geometry.
    pub outlier_share: f64,
    /// Share of a pair's raw matches that are wrong anyhow.
    pub raw_outlier_share: f64,
    /// Wrong pairs (a geometry between images that do not overlap), as a share of the right ones.
    pub wrong_pair_share: f64,
    /// Probability that a visible point becomes a keypoint.
    pub detection_rate: f64,
    /// Probability that two keypoints of one point are matched in a pair.
    pub match_rate: f64,
    /// Keypoints that belong to no point, as a share of those that do.
    pub distractor_share: f64,
    /// Pairs with fewer true matches are left out.
    pub min_pair_matches: usize,
    /// Each image keeps only its strongest pairs with later images; `None` for all.
    pub max_pairs_per_image: Option<usize>,
    /// Cameras, given to the images in turn; 0 for one per image.
    pub num_cameras: usize,
    /// Models, given to the cameras in turn.
    pub models: Vec<CameraModel>,
    /// Focal length over the larger side of an image.
    pub focal_ratio: f64,
    /// What the database knows of the focal lengths.
    pub focal: FocalKnowledge,
    /// Which relative poses stand in the database.
    pub poses: StoredPoses,
    /// Street only: the drive ends where it began.
    pub loop_closure: bool,
    /// Keep each keypoint's true depth.
    pub depth: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            kind: Kind::Orbit,
            num_images: 20,
            num_points: 1000,
            seed: 0,
            image_size_px: [1600, 1200],
            // SIFT's localisation error on sharp photos.
            noise_px: 0.5,
            outlier_share: 0.02,
            raw_outlier_share: 0.2,
            wrong_pair_share: 0.0,
            detection_rate: 0.8,
            match_rate: 0.85,
            distractor_share: 0.3,
            // COLMAP's `min_num_inliers` of two-view geometry (algorithms.md §2.2).
            min_pair_matches: 15,
            max_pairs_per_image: None,
            num_cameras: 1,
            models: vec![CameraModel::SimpleRadial],
            // A typical photograph: 58° across.
            focal_ratio: 0.9,
            focal: FocalKnowledge::Exact,
            poses: StoredPoses::Estimated,
            loop_closure: false,
            depth: false,
        }
    }
}

impl Options {
    /// Refuses values outside their domain.
    pub(crate) fn check(&self) -> Result<(), SynthError> {
        let bad = |name, value: String, expected| Err(SynthError::InvalidOption { name, value, expected });
        for (name, share, limit) in [
            ("outlier_share", self.outlier_share, 0.9),
            ("raw_outlier_share", self.raw_outlier_share, 0.99),
            ("wrong_pair_share", self.wrong_pair_share, 10.0),
            ("detection_rate", self.detection_rate, 1.0),
            ("match_rate", self.match_rate, 1.0),
            ("distractor_share", self.distractor_share, 100.0),
        ] {
            if !(0.0..=limit).contains(&share) {
                return bad(name, share.to_string(), "a share of 0 or more, below 1 where it is part of a whole");
            }
        }
        if !(self.noise_px >= 0.0 && self.noise_px.is_finite()) {
            return bad("noise_px", self.noise_px.to_string(), "0 or a positive number of pixels");
        }
        if !(0.1..=100.0).contains(&self.focal_ratio) {
            return bad("focal_ratio", self.focal_ratio.to_string(), "0.1 to 100 times the larger side of an image");
        }
        if self.models.is_empty() {
            return bad("models", "empty".into(), "at least one camera model");
        }
        if self.image_size_px.iter().any(|&side| !(16..=100_000).contains(&side)) {
            return bad("image_size_px", format!("{:?}", self.image_size_px), "sides of 16 to 100000 pixels");
        }
        // Image ids are 1-based and must stay below COLMAP's 2147483647; keypoint indices are u32.
        if self.num_images > 10_000_000 || self.num_points > 1_000_000_000 {
            return bad(
                "num_images, num_points",
                format!("{}, {}", self.num_images, self.num_points),
                "up to 1e7 images and 1e9 points",
            );
        }
        Ok(())
    }
}
