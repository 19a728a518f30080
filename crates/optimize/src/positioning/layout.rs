//! The problem as the solver walks it: only what constrains something, tracks sorted by camera, fixed chunks of work.

use std::ops::Range;

use epipole_geometry::camera::Real;

use super::problem::Problem;
use super::vec3::{self, Vec3};
use crate::error::OptimizeError;
use crate::grouping::group;
use crate::parallel;

/// Observations per chunk of points. Large enough to hide the cost of handing out work, small enough to balance two to
/// sixteen threads on a small scene. Chunks depend on the problem alone, so results do not depend on the threads.
const CHUNK_OBSERVATIONS: usize = 2048;

/// Sizes are taken from at most this many observations at a fixed stride: a median needs no more.
const SAMPLE: usize = 4096;

/// Which observations of a [`Problem`] are solved with, in the order the passes want them.
///
/// *Cameras* are the images with at least one such observation, *points* those seen by two or more images.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// Image of each camera.
    pub(crate) image_of_camera: Vec<u32>,
    /// Problem point of each point.
    pub(crate) source_point: Vec<u32>,
    /// Per point, where its observations begin (one more entry than points).
    pub(crate) track_start: Vec<u32>,
    /// Camera of each observation; within a track ascending.
    pub(crate) camera: Vec<u32>,
    /// Point of each observation.
    pub(crate) point: Vec<u32>,
    /// Problem observation of each observation.
    pub(crate) source: Vec<u32>,
    /// Per camera, where its list in `camera_observation` begins (one more entry than cameras).
    pub(crate) camera_start: Vec<u32>,
    /// Observations of each camera, ascending.
    pub(crate) camera_observation: Vec<u32>,
    /// Ranges of points of about [`CHUNK_OBSERVATIONS`] observations.
    pub(crate) chunks: Vec<Range<usize>>,
    /// Ranges of cameras, likewise.
    camera_chunks: Vec<Range<usize>>,
    /// Connected component of each camera: cameras that see a common point are connected. Numbered by first camera.
    pub(crate) component: Vec<u32>,
}

impl Layout {
    /// Keeps the observations for which `keep` is true (all, without it), then points seen by two or more images.
    ///
    /// # Errors
    /// [`OptimizeError::NothingToPosition`] when no such point is left.
    pub(crate) fn new(problem: &Problem, keep: Option<&[bool]>) -> Result<Self, OptimizeError> {
        let kept = |observation: &usize| keep.is_none_or(|keep| keep[*observation]);
        let mut camera_of_image = vec![u32::MAX; problem.centers.len()];
        let mut source_point = Vec::new();
        let mut track_start = vec![0u32];
        let mut source: Vec<u32> = Vec::with_capacity(problem.observations());
        for point in 0..problem.points.len() {
            let begin = source.len();
            source.extend(problem.track(point).filter(kept).map(|o| o as u32));
            let track = &mut source[begin..];
            // Two observations in one image come from one centre: they fix no distance.
            track.sort_by_key(|&o| (problem.observation_image[o as usize], o));
            let several = match (track.first(), track.last()) {
                (Some(&a), Some(&b)) => problem.observation_image[a as usize] != problem.observation_image[b as usize],
                _ => false,
            };
            if !several {
                source.truncate(begin);
                continue;
            }
            for &o in &source[begin..] {
                camera_of_image[problem.observation_image[o as usize] as usize] = 0;
            }
            source_point.push(point as u32);
            track_start.push(source.len() as u32);
        }
        if source_point.is_empty() {
            return Err(OptimizeError::NothingToPosition {
                images: problem.centers.len(),
                points: problem.points.len(),
                observations: problem.observations(),
            });
        }
        let mut image_of_camera = Vec::new();
        for (image, camera) in camera_of_image.iter_mut().enumerate() {
            if *camera == 0 {
                *camera = image_of_camera.len() as u32;
                image_of_camera.push(image as u32);
            }
        }
        let camera: Vec<u32> =
            source.iter().map(|&o| camera_of_image[problem.observation_image[o as usize] as usize]).collect();
        let mut point = Vec::with_capacity(source.len());
        for (p, track) in track_start.windows(2).enumerate() {
            point.resize(track[1] as usize, p as u32);
        }
        let (camera_start, camera_observation) = group(&camera, image_of_camera.len());
        let point_chunks = chunks(&track_start);
        let camera_chunks = chunks(&camera_start);
        let component = components(&track_start, &camera, image_of_camera.len());
        Ok(Self {
            image_of_camera,
            source_point,
            track_start,
            camera,
            point,
            source,
            camera_start,
            camera_observation,
            chunks: point_chunks,
            camera_chunks,
            component,
        })
    }

    /// Number of cameras.
    pub(crate) fn cameras(&self) -> usize {
        self.image_of_camera.len()
    }

    /// Number of points.
    pub(crate) fn points(&self) -> usize {
        self.source_point.len()
    }

    /// Number of observations.
    pub(crate) fn observations(&self) -> usize {
        self.source.len()
    }

    /// Observations of a point.
    pub(crate) fn track(&self, point: usize) -> Range<usize> {
        self.track_start[point] as usize..self.track_start[point + 1] as usize
    }

    /// Observations of a camera, ascending.
    pub(crate) fn of_camera(&self, camera: usize) -> &[u32] {
        &self.camera_observation[self.camera_start[camera] as usize..self.camera_start[camera + 1] as usize]
    }

    /// Where each chunk's points begin, and the end: for cutting arrays of points.
    pub(crate) fn point_offsets(&self) -> Vec<usize> {
        std::iter::once(0).chain(self.chunks.iter().map(|chunk| chunk.end)).collect()
    }

    /// Where each chunk's observations begin, and the end: for cutting arrays of observations.
    pub(crate) fn observation_offsets(&self) -> Vec<usize> {
        self.point_offsets().into_iter().map(|point| self.track_start[point] as usize).collect()
    }

    /// `f(camera)` for every camera, in portions of about [`CHUNK_OBSERVATIONS`] observations.
    pub(crate) fn map_cameras<R: Send>(&self, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
        let mut results: Vec<Vec<R>> = parallel::map_indices(self.camera_chunks.len(), |chunk| {
            self.camera_chunks[chunk].clone().map(&f).collect()
        });
        if results.len() == 1 { results.swap_remove(0) } else { results.into_iter().flatten().collect() }
    }

    /// The observations that medians are taken of.
    pub(crate) fn sample(&self) -> impl Iterator<Item = usize> + use<> {
        let count = self.observations();
        (0..count).step_by(count.div_ceil(SAMPLE).max(1))
    }

    /// Number of block products of the explicit reduced system, Σ k (k + 1) / 2 over tracks of length k.
    pub(crate) fn pairs(&self) -> f64 {
        self.track_start.windows(2).map(|t| (t[1] - t[0]) as f64).map(|k| 0.5 * k * (k + 1.0)).sum()
    }
}

/// The observations a solver works on, in its own precision.
#[derive(Clone, Debug)]
pub(crate) struct Rays<T> {
    /// Unit ray in the world, per observation.
    pub(crate) direction: Vec<Vec3<T>>,
    /// ω of each observation.
    pub(crate) weight: Vec<T>,
    /// 1 / ray length, or 0 where the scale is free.
    pub(crate) pin: Vec<T>,
    /// Whether any pin is set: then the scale of the world is known.
    pub(crate) metric: bool,
}

impl<T: Real> Rays<T> {
    /// Gathers the rays in the layout's order.
    pub(crate) fn new(problem: &Problem, layout: &Layout) -> Self {
        let direction =
            layout.source.iter().map(|&o| vec3::from_dvec3(problem.observation_ray[o as usize].normalize())).collect();
        let weight = layout.source.iter().map(|&o| T::from_f64(problem.weight(o as usize))).collect();
        let pin: Vec<T> = layout.source.iter().map(|&o| T::from_f64(problem.pin(o as usize).unwrap_or(0.0))).collect();
        let metric = pin.iter().any(|&pin| pin > T::ZERO);
        Self { direction, weight, pin, metric }
    }
}

fn chunks(start: &[u32]) -> Vec<Range<usize>> {
    let count = start.len() - 1;
    let mut chunks = Vec::new();
    let mut begin = 0;
    for end in 1..=count {
        if (start[end] - start[begin]) as usize >= CHUNK_OBSERVATIONS || end == count {
            chunks.push(begin..end);
            begin = end;
        }
    }
    chunks
}

fn components(track_start: &[u32], camera: &[u32], cameras: usize) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..cameras as u32).collect();
    fn root(parent: &mut [u32], mut c: u32) -> u32 {
        while parent[c as usize] != c {
            parent[c as usize] = parent[parent[c as usize] as usize];
            c = parent[c as usize];
        }
        c
    }
    for track in track_start.windows(2) {
        let first = root(&mut parent, camera[track[0] as usize]);
        for o in track[0] + 1..track[1] {
            let a = root(&mut parent, first);
            let b = root(&mut parent, camera[o as usize]);
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut label = vec![u32::MAX; cameras];
    let mut count = 0;
    (0..cameras as u32)
        .map(|c| {
            let r = root(&mut parent, c) as usize;
            if label[r] == u32::MAX {
                label[r] = count;
                count += 1;
            }
            label[r]
        })
        .collect()
}
