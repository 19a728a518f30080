//! A finished scene: what a database would hold, and the truth behind it.

use std::sync::Arc;

use epipole_scene::{Image, Observation, Point, Reconstruction, ViewGraph, ViewImage};
use glam::DVec2;

use super::observe::Keypoint;
use super::pairs::Photographs;
use super::{Options, SynthError, cameras, layout, observe, pairs};

/// A synthetic scene.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What the pipeline is given, raw matches included.
    pub graph: ViewGraph,
    /// True intrinsics, poses and points; the tracks are all keypoints of points that two or more images see.
    pub truth: Reconstruction,
    /// True depth of every keypoint along the optical axis, metres, NaN for keypoints of nothing; if asked for.
    pub depth_m: Option<Vec<Vec<f64>>>,
}

/// Makes the scene that the options describe.
pub fn generate(options: &Options) -> Result<Scene, SynthError> {
    options.check()?;
    let layout = layout::build(options);
    let cameras = cameras::build(options, &layout.zoom);
    let keypoints = observe::photograph(options, &layout, &cameras);
    let pairs = pairs::build(&Photographs { options, cameras: &cameras, keypoints: &keypoints, layout: &layout });

    let images: Vec<Image> = keypoints
        .iter()
        .enumerate()
        .map(|(i, keypoints)| Image {
            id: i as u32 + 1,
            name: format!("{i:05}.jpg"),
            camera: cameras.of_image[i],
            cam_from_world: layout.cam_from_world[i],
            keypoints_px: keypoints.iter().map(|k| k.pixel_px).collect::<Arc<[DVec2]>>(),
            depths: None,
        })
        .collect();
    let view = |i: &Image| ViewImage {
        id: i.id,
        name: i.name.clone(),
        camera: i.camera,
        keypoints_px: i.keypoints_px.clone(),
        depths: i.depths.clone(),
    };
    let graph = ViewGraph { images: images.iter().map(view).collect(), cameras: cameras.stored, pairs };
    let mut truth = Reconstruction { cameras: cameras.truth, images, ..Reconstruction::default() };
    truth.points = true_points(&layout, &keypoints);
    for p in 0..truth.points.len() {
        let point = &truth.points[p];
        let sum: f64 = point.observations.iter().map(|&o| truth.reprojection_error_px(point, o)).sum();
        truth.points[p].error_px = sum / point.observations.len() as f64;
    }
    let depth = |image: &Vec<Keypoint>| image.iter().map(|k| k.depth).collect();
    let depth_m = options.depth.then(|| keypoints.iter().map(depth).collect());
    Ok(Scene { graph, truth, depth_m })
}

fn true_points(layout: &layout::Layout, keypoints: &[Vec<Keypoint>]) -> Vec<Point> {
    let mut tracks: Vec<Vec<Observation>> = vec![Vec::new(); layout.points.len()];
    for (i, image) in keypoints.iter().enumerate() {
        for (k, keypoint) in image.iter().enumerate() {
            if let Some(point) = keypoint.point {
                tracks[point as usize].push(Observation { image: i as u32, keypoint: k as u32 });
            }
        }
    }
    let seen = tracks.into_iter().zip(&layout.points).enumerate().filter(|(_, (track, _))| track.len() >= 2);
    seen.map(|(p, (observations, point))| Point {
        id: p as u64 + 1,
        position: point.position,
        rgb: point.rgb,
        error_px: -1.0,
        observations,
    })
    .collect()
}

impl Scene {
    /// Puts another scene's images, cameras and pairs beside this one's, unconnected, with ids that go on;
    /// the truths stay apart: this one's grows by nothing, the other's is returned with its new ids and names.
    pub fn append(&mut self, other: Scene) -> Reconstruction {
        let (images, cameras) = (self.graph.images.len(), self.graph.cameras.len());
        let mut truth = other.truth;
        let rename = |id: &mut u32, name: &mut String| {
            *id += images as u32;
            *name = format!("{:05}.jpg", *id - 1);
        };
        for camera in truth.cameras.iter_mut() {
            camera.id += cameras as u32;
        }
        for image in truth.images.iter_mut() {
            rename(&mut image.id, &mut image.name);
        }
        for mut camera in other.graph.cameras {
            camera.id += cameras as u32;
            self.graph.cameras.push(camera);
        }
        for mut image in other.graph.images {
            rename(&mut image.id, &mut image.name);
            image.camera += cameras;
            self.graph.images.push(image);
        }
        for mut pair in other.graph.pairs {
            pair.image1 += images;
            pair.image2 += images;
            self.graph.pairs.push(pair);
        }
        truth
    }
}
