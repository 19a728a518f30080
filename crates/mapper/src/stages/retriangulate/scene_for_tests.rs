//! A small scene with known truth for the tests of this stage: cameras on an arc, points in a ball, matches with and
//! without mistakes.

use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::{Observation, Pair, PairConfig, Point, ViewGraph, ViewImage};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::component::Component;
use crate::correspondences::CorrespondenceGraph;

/// What to build.
pub(super) struct Recipe {
    pub(super) images: usize,
    pub(super) points: usize,
    /// Images of the sequence that an image is matched with, after it.
    pub(super) overlap: usize,
    /// Half the width of the keypoints' uniform noise, px.
    pub(super) noise_px: f64,
    /// Share of matches whose second end is moved to a random keypoint.
    pub(super) wrong_matches: f64,
    pub(super) seed: u64,
}

impl Default for Recipe {
    fn default() -> Self {
        Self { images: 8, points: 120, overlap: 3, noise_px: 0.0, wrong_matches: 0.0, seed: 1 }
    }
}

/// A view graph, the posed component of all its images, and the truth.
pub(super) struct Scene {
    pub(super) graph: ViewGraph,
    pub(super) component: Component,
    pub(super) points: Vec<DVec3>,
    /// For every image and keypoint, the point it shows.
    pub(super) truth: Vec<Vec<usize>>,
}

impl Recipe {
    pub(super) fn build(&self) -> Scene {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let points: Vec<DVec3> =
            (0..self.points).map(|_| DVec3::from_array([0; 3].map(|_| random.random_range(-1.0..1.0)))).collect();
        let mut camera = Camera::with_focal(1, CameraModel::SimpleRadial, 800, 600, 700.0);
        camera.params[3] = -0.05;
        let mut graph = ViewGraph { cameras: vec![camera.clone()], ..ViewGraph::default() };
        let mut poses = Vec::new();
        let mut truth = Vec::new();
        for i in 0..self.images {
            // Six degrees from image to image, five units from the middle of the points.
            let angle = 6f64.to_radians() * i as f64;
            let pose = look_at_origin(DVec3::new(5.0 * angle.sin(), 0.3 * (i % 3) as f64, -5.0 * angle.cos()));
            let mut shown: Vec<usize> = (0..points.len()).collect();
            for k in (1..shown.len()).rev() {
                shown.swap(k, random.random_range(0..=k));
            }
            let keypoints = shown.iter().map(|&p| {
                let noise = DVec2::new(random.random_range(-1.0..=1.0), random.random_range(-1.0..=1.0));
                camera.project(pose.transform_point(points[p])).unwrap() + self.noise_px * noise
            });
            let keypoints: Vec<DVec2> = keypoints.collect();
            graph.images.push(ViewImage {
                id: i as u32 + 1,
                name: format!("{i:03}.jpg"),
                camera: 0,
                keypoints_px: Arc::from(keypoints),
                depths: None,
            });
            poses.push(pose);
            truth.push(shown);
        }
        for i in 0..self.images {
            for j in i + 1..(i + 1 + self.overlap).min(self.images) {
                let mut inliers = Vec::new();
                for (k1, point) in truth[i].iter().enumerate() {
                    let mut k2 = truth[j].iter().position(|p| p == point).unwrap();
                    if random.random_range(0.0..1.0) < self.wrong_matches {
                        k2 = random.random_range(0..truth[j].len());
                    }
                    inliers.push([k1 as u32, k2 as u32]);
                }
                graph.pairs.push(pair(i, j, inliers));
            }
        }
        let component = posed(&graph, &poses);
        Scene { graph, component, points, truth }
    }
}

impl Scene {
    pub(super) fn correspondences(&self) -> CorrespondenceGraph {
        CorrespondenceGraph::new(&self.graph, &vec![true; self.graph.pairs.len()])
    }

    /// The keypoint of an image that shows a point.
    pub(super) fn keypoint(&self, image: usize, point: usize) -> Observation {
        let keypoint = self.truth[image].iter().position(|&p| p == point).unwrap();
        Observation { image: image as u32, keypoint: keypoint as u32 }
    }

    /// The true point seen from the given images.
    pub(super) fn point(&self, point: usize, images: &[usize]) -> Point {
        Point {
            id: point as u64 + 1,
            position: self.points[point],
            rgb: [0; 3],
            error_px: -1.0,
            observations: images.iter().map(|&i| self.keypoint(i, point)).collect(),
        }
    }

    /// Leaves only the matches that `keep` accepts, as (image 1, image 2, point).
    pub(super) fn retain_matches(&mut self, keep: impl Fn(usize, usize, usize) -> bool) {
        let truth = &self.truth;
        for pair in &mut self.graph.pairs {
            let (i, j) = (pair.image1, pair.image2);
            pair.inliers.retain(|m| keep(i, j, truth[i][m[0] as usize]));
        }
    }
}

/// A pair with verified matches and nothing else.
pub(super) fn pair(image1: usize, image2: usize, inliers: Vec<[u32; 2]>) -> Pair {
    Pair { config: PairConfig::Calibrated, num_matches: inliers.len(), inliers, ..Pair::unverified(image1, image2) }
}

fn posed(graph: &ViewGraph, poses: &[Rigid3]) -> Component {
    let rotations: Vec<(usize, DQuat)> = poses.iter().enumerate().map(|(i, p)| (i, p.rotation)).collect();
    let mut component = Component::new(graph, &rotations, &crate::metric::Options::default());
    for (image, pose) in component.reconstruction.images.iter_mut().zip(poses) {
        image.cam_from_world = *pose;
    }
    component
}

fn look_at_origin(center: DVec3) -> Rigid3 {
    let forward = (-center).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let down = forward.cross(right);
    let world_from_cam = DMat3::from_cols(right, down, forward);
    Rigid3::from_rotation_and_center(DQuat::from_mat3(&world_from_cam.transpose()), center)
}
