//! The pairs of a match database: raw matches, verified matches, and the geometry found with them.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use epipole_scene::{Pair, PairConfig};
use glam::{DMat3, DQuat, DVec3};

use super::cameras::{Cameras, is_perspective, without_distortion};
use super::layout::Layout;
use super::observe::Keypoint;
use super::options::{FocalKnowledge, Options, StoredPoses};
use super::overlap::{self, Overlap};
use super::random::{Random, Stream};
use super::relative_pose::{essential, refine, sampson_rad};

/// A wrong match survives verification when it is this close to its epipolar line; COLMAP's bound is 4 px.
const VERIFIED_SAMPSON_PX: f64 = 3.0;
/// Random candidates tried for each wrong match.
const ATTEMPTS_PER_OUTLIER: usize = 400;
/// Matches of a wrong pair: what accidental agreement yields just above COLMAP's bound of 15.
const WRONG_PAIR_MATCHES: [usize; 2] = [16, 40];

/// Everything the pairs are made from.
pub(crate) struct Photographs<'a> {
    pub(crate) options: &'a Options,
    pub(crate) cameras: &'a Cameras,
    pub(crate) keypoints: &'a [Vec<Keypoint>],
    pub(crate) layout: &'a Layout,
}

/// All pairs, sorted by (image1, image2).
pub(crate) fn build(photographs: &Photographs) -> Vec<Pair> {
    let mut random = Random::new(photographs.options.seed, Stream::Pairs);
    // The rays as the pair's solver would see them.
    let rays: Vec<Vec<DVec3>> = (0..photographs.keypoints.len()).map(|i| photographs.solver_rays(i)).collect();
    let overlaps = overlap::find(photographs.options, photographs.layout, photographs.keypoints);
    let mut pairs: Vec<Pair> = overlaps.iter().filter_map(|o| photographs.pair(o, &rays, &mut random)).collect();
    photographs.add_wrong_pairs(&mut pairs, &rays, &mut random);
    pairs.sort_by_key(|pair| (pair.image1, pair.image2));
    pairs
}

impl Photographs<'_> {
    /// The camera through which the two-view solver sees an image: the database's, or, where only a fundamental
    /// matrix can be found, the pinhole part of the true one.
    fn solver_camera(&self, image: usize) -> Camera {
        let c = self.cameras.of_image[image];
        if self.uncalibrated(image) {
            without_distortion(&self.cameras.truth[c])
        } else {
            self.cameras.stored[c].clone()
        }
    }

    fn uncalibrated(&self, image: usize) -> bool {
        let camera = &self.cameras.stored[self.cameras.of_image[image]];
        self.options.focal == FocalKnowledge::Guessed && is_perspective(camera)
    }

    fn solver_rays(&self, image: usize) -> Vec<DVec3> {
        let camera = self.solver_camera(image);
        let ray = |k: &Keypoint| camera.ray_from_pixel(k.pixel_px).unwrap_or(k.ray);
        self.keypoints[image].iter().map(ray).collect()
    }

    fn pair(&self, overlap: &Overlap, rays: &[Vec<DVec3>], random: &mut Random) -> Option<Pair> {
        let options = self.options;
        let (i, j) = (overlap.image1, overlap.image2);
        let mut inliers: Vec<[u32; 2]> =
            overlap.common.iter().copied().filter(|_| random.chance(options.match_rate)).collect();
        if inliers.len() < options.min_pair_matches {
            return None;
        }
        let mut truth = self.layout.cam_from_world[j] * self.layout.cam_from_world[i].inverse();
        truth.translation = truth.translation.normalize_or(DVec3::X);
        let wanted = (inliers.len() as f64 * options.outlier_share / (1.0 - options.outlier_share)).round() as usize;
        self.add_consistent_matches(&mut inliers, wanted, &essential(&truth), [i, j], rays, random);
        let pose = match options.poses {
            StoredPoses::Perturbed { rotation_deg, direction_deg } => Rigid3::new(
                DQuat::from_scaled_axis(random.gaussian3(rotation_deg.to_radians())) * truth.rotation,
                (truth.translation + random.gaussian3(direction_deg.to_radians())).normalize_or(DVec3::X),
            ),
            StoredPoses::Absent | StoredPoses::Estimated => refine(&truth, &ray_pairs(&inliers, [i, j], rays)),
        };
        Some(self.finished(i, j, inliers, pose, random))
    }

    /// Adds the raw matches and the matrices.
    fn finished(&self, i: usize, j: usize, mut inliers: Vec<[u32; 2]>, pose: Rigid3, random: &mut Random) -> Pair {
        let options = self.options;
        inliers.sort_unstable();
        let wrong = (inliers.len() as f64 * options.raw_outlier_share / (1.0 - options.raw_outlier_share)).round();
        let mut matches = inliers.clone();
        let mut used = Used::new(&inliers, [&self.keypoints[i], &self.keypoints[j]]);
        for _ in 0..wrong as usize {
            let candidate =
                [random.index(self.keypoints[i].len()) as u32, random.index(self.keypoints[j].len()) as u32];
            if used.take(candidate) {
                matches.push(candidate);
            }
        }
        matches.sort_unstable();
        let calibrated = !self.uncalibrated(i) && !self.uncalibrated(j);
        let e = essential(&pose);
        let [k1, k2] = [i, j].map(|image| self.solver_camera(image));
        let perspective = is_perspective(&k1) && is_perspective(&k2);
        let fundamental = perspective.then(|| {
            let f = calibration(&k2).inverse().transpose() * e * calibration(&k1).inverse();
            // Any scale will do; COLMAP's solvers return unit Frobenius norm.
            let norm = f.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
            f * (1.0 / norm.max(f64::MIN_POSITIVE))
        });
        Pair {
            image1: i,
            image2: j,
            config: if calibrated { PairConfig::Calibrated } else { PairConfig::Uncalibrated },
            fundamental,
            essential: calibrated.then_some(e),
            homography: None,
            cam2_from_cam1: (calibrated && options.poses != StoredPoses::Absent).then_some(pose),
            solver_cameras: [None, None],
            num_matches: matches.len(),
            inliers,
            matches: Some(matches),
        }
    }

    /// Adds up to `wanted` accidental matches that agree with the epipolar geometry.
    fn add_consistent_matches(
        &self,
        inliers: &mut Vec<[u32; 2]>,
        wanted: usize,
        essential: &DMat3,
        [i, j]: [usize; 2],
        rays: &[Vec<DVec3>],
        random: &mut Random,
    ) {
        if rays[i].is_empty() || rays[j].is_empty() {
            return;
        }
        let [f1, f2] = [i, j].map(|image| self.solver_camera(image).mean_focal_px());
        let bound_rad = VERIFIED_SAMPSON_PX * 0.5 * (1.0 / f1 + 1.0 / f2);
        let mut used = Used::new(inliers, [&self.keypoints[i], &self.keypoints[j]]);
        let target = inliers.len() + wanted;
        for _ in 0..wanted * ATTEMPTS_PER_OUTLIER {
            if inliers.len() == target {
                break;
            }
            let candidate = [random.index(rays[i].len()) as u32, random.index(rays[j].len()) as u32];
            let pair = [rays[i][candidate[0] as usize], rays[j][candidate[1] as usize]];
            if sampson_rad(essential, &pair).abs() < bound_rad && used.take(candidate) {
                inliers.push(candidate);
            }
        }
    }

    /// Pairs between images that do not overlap, with a geometry that is pure accident, as repeated structure makes.
    fn add_wrong_pairs(&self, pairs: &mut Vec<Pair>, rays: &[Vec<DVec3>], random: &mut Random) {
        let n = self.keypoints.len();
        let wanted = (pairs.len() as f64 * self.options.wrong_pair_share).round() as usize;
        if n < 2 {
            return;
        }
        let mut taken: std::collections::BTreeSet<_> = pairs.iter().map(|p| (p.image1, p.image2)).collect();
        let mut made = 0;
        for _ in 0..20 * wanted {
            if made == wanted {
                break;
            }
            let (a, b) = (random.index(n), random.index(n));
            let (i, j) = (a.min(b), a.max(b));
            if a == b || taken.contains(&(i, j)) {
                continue;
            }
            let pose =
                Rigid3::new(DQuat::from_scaled_axis(random.direction() * random.uniform(0.2, 1.0)), random.direction());
            let count = WRONG_PAIR_MATCHES[0] + random.index(WRONG_PAIR_MATCHES[1] - WRONG_PAIR_MATCHES[0]);
            let mut inliers = Vec::new();
            self.add_consistent_matches(&mut inliers, count, &essential(&pose), [i, j], rays, random);
            if inliers.len() >= WRONG_PAIR_MATCHES[0] {
                taken.insert((i, j));
                pairs.push(self.finished(i, j, inliers, pose, random));
                made += 1;
            }
        }
    }
}

fn ray_pairs(inliers: &[[u32; 2]], [i, j]: [usize; 2], rays: &[Vec<DVec3>]) -> Vec<[DVec3; 2]> {
    inliers.iter().map(|m| [rays[i][m[0] as usize], rays[j][m[1] as usize]]).collect()
}

fn calibration(camera: &Camera) -> DMat3 {
    let p = without_distortion(camera).params;
    DMat3::from_cols(DVec3::new(p[0], 0.0, 0.0), DVec3::new(0.0, p[1], 0.0), DVec3::new(p[2], p[3], 1.0))
}

/// Keeps matches one to one.
struct Used([Vec<bool>; 2]);

impl Used {
    fn new(matches: &[[u32; 2]], keypoints: [&[Keypoint]; 2]) -> Self {
        let mut used = Self(keypoints.map(|k| vec![false; k.len()]));
        for m in matches {
            used.take(*m);
        }
        used
    }

    /// Claims both keypoints, if both are free.
    fn take(&mut self, [a, b]: [u32; 2]) -> bool {
        let free = !self.0[0][a as usize] && !self.0[1][b as usize];
        if free {
            self.0[0][a as usize] = true;
            self.0[1][b as usize] = true;
        }
        free
    }
}
