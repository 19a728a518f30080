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
            let residuals: Vec<[f32; 4]> = device.download(&buffers.residuals, chunk.by_point.len()).await?;
            let by_point: Vec<[u32; 2]> = device.download(&buffers.by_point, chunk.by_point.len()).await?;
            // In the device's order: compaction moves observations within their tracks.
            let pixels: Vec<[f32; 2]> = device.download(&buffers.pixels, chunk.pixels.len()).await?;
            for (p, track) in chunk.tracks.windows(2).enumerate() {
                let part: f64 = (track[0] as usize..track[1] as usize)
                    .map(|o| {
                        let image = (by_point[o][0] & !(OUT | HIDDEN)) as usize;
                        let kept = residuals[o];
                        let kept = f64::from(kept[0]).powi(2) + f64::from(kept[1]).powi(2);
                        let counts = by_point[o][0] & OUT == 0;
                        if !counts && self.resident.params.activation == TRUNCATED {
                            return self.tau();
                        }
                        let now =
                            counts.then(|| self.square(problem, chunk.first_point + p, image, pixels[o])).flatten();
                        problem.loss.value(now.unwrap_or(kept))
                    })
                    .sum();
                sum += part;
            }
        }
        Ok(0.5 * sum + prior_cost(problem))
    }

    /// Squared residual of an observation in `f64`.
    fn square(&self, problem: &Problem, point: usize, image: usize, px: [f32; 2]) -> Option<f64> {
        let camera = &problem.cameras[problem.image_camera[image] as usize];
        let q = problem.cam_from_world[image].transform_point(problem.points[point]);
        let both_sides = self.resident.params.activation == ALL && camera.model != CameraModel::Equirectangular;
        let q = if q.z < 0.0 && both_sides { -q } else { q };
        let [x, y] = project(camera.model, &camera.params, q.to_array())?;
        let px = px.map(f64::from);
        Some((x - px[0]).powi(2) + (y - px[1]).powi(2))
    }

    fn write_state(&self, problem: &mut Problem, state: &Snapshot) {
        self.write_cameras(problem, &state.views, &state.intrinsics);
        for (chunk, points) in self.layout.chunks.iter().zip(&state.points) {
            self.write_points(problem, chunk, points);
        }
    }

    fn write_cameras(&self, problem: &mut Problem, views: &[View], intrinsics: &[Intrinsics]) {
        let lattice = &self.layout.lattice;
        let real = f32::from_bits;
        for ((pose, view), freedom) in problem.cam_from_world.iter_mut().zip(views).zip(&problem.pose_freedom) {
            let row = |k: usize| DVec3::from_array(std::array::from_fn(|j| f64::from(real(view[4 * k + j]))));
            let rotation = DQuat::from_mat3(&DMat3::from_cols(row(0), row(1), row(2)).transpose()).normalize();
            let cell = std::array::from_fn(|k| view[12 + k] as i32);
            let center = lattice.center_position(cell, std::array::from_fn(|k| real(view[4 * k + 3])));
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
                *position = self.layout.lattice.position(point[3], std::array::from_fn(|k| f32::from_bits(point[k])));
            }
        }
    }
}
