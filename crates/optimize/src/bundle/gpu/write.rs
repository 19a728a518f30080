//! From the device back into the problem.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{CameraModel, project};
use glam::{DMat3, DQuat, DVec3};

use super::checkpoint::{Checkpoint, Snapshot};
use super::chunk::Chunk;
use super::priors::prior_cost;
use super::records::{ALL, HIDDEN, Intrinsics, OUT, Point, TRUNCATED, View, param_slot};
use super::system::GpuSystem;
use crate::bundle::problem::{PoseFreedom, Problem};
use crate::gpu::GpuError;
use crate::lm::Places;

/// An observation's `Residual`: what the device last knew of it, and what was measured of its depth.
struct Held {
    errors: [f64; 3],
    inverse: f64,
    weight: f64,
}

impl Held {
    fn new(record: &[f32]) -> Self {
        // Without depth there is nothing behind the pixel.
        let [x, y, depth, inverse, weight] =
            [0, 1, 4, 6, 7].map(|k| f64::from(record.get(k).copied().unwrap_or_default()));
        Self { errors: [x, y, depth], inverse, weight }
    }
}

impl GpuSystem<'_> {
    /// Writes the accepted state back, and returns its cost evaluated from the written values in `f64`. Where that fails
    /// the problem is as it was.
    pub async fn write(&self, problem: &mut Problem) -> Result<f64, GpuError> {
        let state = self.download_state().await?;
        let before = problem.clone();
        self.write_state(problem, &state);
        let cost = self.written_cost(problem).await;
        if cost.is_err() {
            *problem = before;
        }
        cost
    }

    /// After a failure: the last state that reached the host, if any did.
    pub(super) fn rescue(&self, problem: &mut Problem) -> Option<Checkpoint> {
        let (checkpoint, state) = self.checkpoints.last()?;
        self.write_state(problem, state);
        Some(*checkpoint)
    }

    async fn download_state(&self) -> Result<Snapshot, GpuError> {
        let (device, buffers, layout) = (self.device(), &self.resident.buffers, &self.layout);
        let (sizes, cameras) = (layout.sizes, layout.intrinsics.len());
        let mut points = Vec::with_capacity(layout.chunks.len());
        for (chunk, buffers) in layout.chunks.iter().zip(&self.resident.chunks) {
            points.push(device.download(&buffers.points, chunk.points.len()).await?);
        }
        Ok(Snapshot {
            views: device.download(&buffers.views, layout.views.len()).await?,
            intrinsics: sizes.unpack(&device.download(&buffers.intrinsics, cameras * sizes.intrinsics()).await?),
            points,
        })
    }

    /// The cost of a problem that holds the accepted state, in `f64`.
    async fn written_cost(&self, problem: &Problem) -> Result<f64, GpuError> {
        let device = self.device();
        let mut sum = 0.0;
        for (chunk, buffers) in self.layout.chunks.iter().zip(&self.resident.chunks) {
            let (count, sizes) = (chunk.by_point.len(), self.layout.sizes);
            let residuals: Vec<f32> = device.download(&buffers.residuals, sizes.residual() * count).await?;
            let by_point: Vec<u32> = device.download(&buffers.by_point, sizes.by_point() * count).await?;
            // In the device's order: compaction moves observations within their tracks.
            let pixels: Vec<[f32; 2]> = device.download(&buffers.pixels, count).await?;
            for (p, track) in chunk.tracks.windows(2).enumerate() {
                let cost = |o: usize| {
                    let word = by_point[sizes.by_point() * o];
                    let held = Held::new(&residuals[sizes.residual() * o..sizes.residual() * (o + 1)]);
                    self.observation_cost(problem, chunk.first_point + p, word, pixels[o], &held)
                };
                sum += (track[0] as usize..track[1] as usize).map(cost).sum::<f64>();
            }
        }
        Ok(0.5 * sum + prior_cost(problem))
    }

    /// What an observation is charged, from the written state where it counts there.
    fn observation_cost(&self, problem: &Problem, point: usize, word: u32, px: [f32; 2], held: &Held) -> f64 {
        let (image, counts) = ((word & !(OUT | HIDDEN)) as usize, word & OUT == 0);
        let depth_loss = self.layout.depth_loss;
        if !counts && self.resident.params.activation == TRUNCATED {
            return self.tau() + if held.weight > 0.0 { depth_loss.bound().unwrap_or(0.0) } else { 0.0 };
        }
        let now = if counts { self.errors(problem, point, image, px, held) } else { None };
        let [x, y, depth] = now.unwrap_or(held.errors);
        problem.loss.value(x * x + y * y) + depth_loss.value((held.weight * depth).powi(2))
    }

    /// Errors of an observation's pixel and of its inverse depth in `f64`.
    fn errors(&self, problem: &Problem, point: usize, image: usize, px: [f32; 2], held: &Held) -> Option<[f64; 3]> {
        let camera = &problem.cameras[problem.image_camera[image] as usize];
        let q = problem.cam_from_world[image].transform_point(problem.points[point]);
        let depth = if held.weight > 0.0 { 1.0 / q.z - held.inverse } else { 0.0 };
        let both_sides = self.resident.params.activation == ALL && camera.model != CameraModel::Equirectangular;
        let q = if q.z < 0.0 && both_sides { -q } else { q };
        let [x, y] = project(camera.model, &camera.params, q.to_array())?;
        let px = px.map(f64::from);
        Some([x - px[0], y - px[1], depth])
    }

    /// Where everything is in a state, for whoever draws it.
    pub(super) fn places_in(&self, state: &Snapshot) -> Places {
        let centers = (0..).zip(state.views.iter().map(|view| self.center(view)));
        let mut points = Vec::new();
        for (chunk, records) in self.layout.chunks.iter().zip(&state.points) {
            let seen = chunk.tracks.windows(2).map(|track| track[0] < track[1]);
            let numbered = (chunk.first_point as u32..).zip(records);
            points
                .extend(numbered.zip(seen).filter(|(_, seen)| *seen).map(|((p, point), _)| (p, self.position(point))));
        }
        Places { centers: centers.collect(), points }
    }

    fn center(&self, view: &View) -> DVec3 {
        let cell = std::array::from_fn(|k| view[12 + k] as i32);
        self.layout.lattice.center_position(cell, std::array::from_fn(|k| f32::from_bits(view[4 * k + 3])))
    }

    fn position(&self, point: &Point) -> DVec3 {
        self.layout.lattice.position(point[3], std::array::from_fn(|k| f32::from_bits(point[k])))
    }

    fn write_state(&self, problem: &mut Problem, state: &Snapshot) {
        self.write_cameras(problem, &state.views, &state.intrinsics);
        for (chunk, points) in self.layout.chunks.iter().zip(&state.points) {
            self.write_points(problem, chunk, points);
        }
    }

    fn write_cameras(&self, problem: &mut Problem, views: &[View], intrinsics: &[Intrinsics]) {
        let real = f32::from_bits;
        for ((pose, view), freedom) in problem.cam_from_world.iter_mut().zip(views).zip(&problem.pose_freedom) {
            let row = |k: usize| DVec3::from_array(std::array::from_fn(|j| f64::from(real(view[4 * k + j]))));
            let rotation = DQuat::from_mat3(&DMat3::from_cols(row(0), row(1), row(2)).transpose()).normalize();
            let center = self.center(view);
            match freedom {
                PoseFreedom::Free => *pose = Rigid3::from_rotation_and_center(rotation, center),
                PoseFreedom::RotationFixed => *pose = Rigid3::from_rotation_and_center(pose.rotation, center),
                PoseFreedom::Fixed => {}
            }
        }
        for ((camera, values), refine) in problem.cameras.iter_mut().zip(intrinsics).zip(&problem.refine_params) {
            for (k, (param, &free)) in camera.params.iter_mut().zip(refine).enumerate() {
                if free {
                    *param = f64::from(real(values[param_slot(camera.model, k)]));
                }
            }
        }
    }

    fn write_points(&self, problem: &mut Problem, chunk: &Chunk, points: &[Point]) {
        if problem.fixed_points {
            return;
        }
        let positions = &mut problem.points[chunk.first_point..];
        for (position, (point, track)) in positions.iter_mut().zip(points.iter().zip(chunk.tracks.windows(2))) {
            if track[0] < track[1] {
                *position = self.position(point);
            }
        }
    }
}
