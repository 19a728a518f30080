//! The positioning problem resident on a GPU: what convex starts and variable projection both queue and read back.

use super::chunks::Chunks;
use super::records::{Gauge, Settings, camera_weights, point_record, ray_records};
use super::resident::Resident;
use crate::gpu::kernels::positioning as kernels;
use crate::gpu::kernels::{Kernel, REDUCE};
use crate::gpu::sums::{ROW_BYTES, totals};
use crate::gpu::{Device, GpuError, Halt, ReadBack, Turns};
use crate::lm::Observer;
use crate::positioning::gauge::Positions;
use crate::positioning::layout::{Layout, Rays};

/// PCG iterations in one submission: bounds its time on slow devices (source: `solver.md` §2.5).
const ITERATIONS_PER_SUBMIT: usize = 8;
/// PCG iterations queued beyond those of the last step, before the host asks whether they were enough; iterations after
/// the stop cost a few empty dispatches.
const SPARE_ITERATIONS: usize = 4;
/// Bytes of PCG state that are read back.
const STATE_BYTES: u64 = 32;

/// Sums that a pass over the points leaves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Totals {
    /// The objective.
    pub(super) cost: f64,
    /// Observations that pull.
    pub(super) active: usize,
}

/// A step that was tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tried {
    pub(super) after: Totals,
    /// Objective before minus objective after.
    pub(super) decrease: f64,
    /// What the undamped model promised.
    pub(super) predicted_decrease: f64,
    pub(super) iterations: usize,
    /// Largest |x √D|, |x| and |C| of a coordinate.
    pub(super) largest: [f64; 3],
}

/// Buffers, kernels and the host's copy of the settings.
#[derive(Debug)]
pub(crate) struct Gpu<'a> {
    device: &'a Device,
    pub(super) layout: &'a Layout,
    pub(super) arrangement: Chunks,
    pub(super) resident: Resident,
    pub(super) settings: Settings,
    read_back: ReadBack,
    weights: Vec<f32>,
    /// Whether some observations are left out at present.
    pub(super) clipped: bool,
    /// Iterations of the last solve: what to queue for the next.
    expected: usize,
    pub(super) read_backs: usize,
    turns: Turns,
}

impl<'a> Gpu<'a> {
    /// Uploads a problem; everything is in the origin. Chunks end at the given number of observations.
    pub(super) fn new(
        device: &'a Device,
        layout: &'a Layout,
        rays: &Rays<f32>,
        chunk_observations: usize,
    ) -> Result<Self, GpuError> {
        let arrangement = Chunks::new(layout, chunk_observations);
        let settings = Settings {
            cameras: layout.cameras() as u32,
            point_groups: arrangement.groups as u32,
            samples: arrangement.samples as u32,
            metric: rays.metric,
            ..Settings::default()
        };
        let weights = camera_weights(layout, rays);
        let records = ray_records(layout, rays, &weights);
        let resident = Resident::new(device, layout.cameras(), &records, &arrangement, &settings)?;
        let read_back = device.read_back("scalars", STATE_BYTES + resident.rows as u64 * ROW_BYTES)?;
        Ok(Self {
            device,
            layout,
            arrangement,
            resident,
            settings,
            read_back,
            weights,
            clipped: false,
            expected: ITERATIONS_PER_SUBMIT,
            read_backs: 0,
            turns: Turns::default(),
        })
    }

    #[cfg(test)]
    pub(super) fn device(&self) -> &'a Device {
        self.device
    }

    /// Bytes on the device.
    #[cfg(test)]
    pub(super) fn resident_bytes(&self) -> u64 {
        self.resident.bytes()
    }

    /// Replaces accepted and tried positions.
    pub(super) fn upload(&mut self, positions: &Positions<f32>) {
        let accepted = positions.centers.iter().zip(&self.weights).map(|(&[x, y, z], &w)| [x, y, z, w]);
        let accepted: Vec<[f32; 4]> = accepted.collect();
        self.device.write(&self.resident.shared.centers, &accepted.repeat(2));
        let points: Vec<[f32; 8]> = positions.points.iter().map(|&point| point_record(point)).collect();
        for (chunk, buffers) in self.arrangement.chunks.iter().zip(&self.resident.chunks) {
            self.device.write(&buffers.points, &points[chunk.points.clone()]);
        }
    }

    /// Leaves observations out, or takes them in again; weights are as at the start else.
    pub(super) fn write_rays(&self, rays: &Rays<f32>) {
        let records = ray_records(self.layout, rays, &self.weights);
        self.resident.write_rays(self.device, &self.arrangement, &records);
    }

    /// The accepted positions.
    pub(super) async fn download(&self) -> Result<Positions<f32>, GpuError> {
        let cameras = self.layout.cameras();
        let centers: Vec<[f32; 4]> = self.device.download(&self.resident.shared.centers, cameras).await?;
        let mut points = Vec::with_capacity(self.layout.points());
        for (chunk, buffers) in self.arrangement.chunks.iter().zip(&self.resident.chunks) {
            let records: Vec<[f32; 8]> = self.device.download(&buffers.points, chunk.points.len()).await?;
            points.extend(records.iter().map(|r| [r[0], r[1], r[2]]));
        }
        Ok(Positions { centers: centers.iter().map(|r| [r[0], r[1], r[2]]).collect(), points })
    }

    pub(super) fn write_settings(&self) {
        self.device.write(&self.resident.shared.settings, &self.settings.words());
    }

    /// Records kernels that are a turn together, and ends the turn where that is due.
    async fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        kernels: &[Kernel],
        observer: &mut dyn Observer,
    ) -> Result<(), Halt> {
        self.resident.record(encoder, kernels)?;
        let observations = kernels.len() * self.layout.camera.len();
        self.turns.take(self.device, encoder, observations, observer).await
    }

    /// Queues the linearisation at the accepted positions.
    pub(super) async fn queue_linearization(&self, observer: &mut dyn Observer) -> Result<(), Halt> {
        self.write_settings();
        let mut encoder = self.device.encoder();
        for kernel in [kernels::LINEARIZE, kernels::SPREAD] {
            self.record(&mut encoder, &[kernel], observer).await?;
        }
        self.device.submit(encoder);
        Ok(self.device.check()?)
    }

    /// Linearises at the accepted positions, and returns the objective there.
    pub(super) async fn linearize(&mut self, observer: &mut dyn Observer) -> Result<Totals, GpuError> {
        self.write_settings();
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        for kernel in [kernels::LINEARIZE, REDUCE, kernels::SPREAD] {
            resident.record(&mut encoder, &[kernel])?;
            self.turns.rest(self.device, &mut encoder, self.layout.camera.len(), observer).await?;
        }
        let bytes = resident.rows as u64 * ROW_BYTES;
        self.read_back.copy(&mut encoder, &resident.shared.reduced, 0, 0, bytes);
        self.device.submit(encoder);
        self.read_backs += 1;
        let rows: Vec<[f32; 8]> = self.read_back.get(self.device, resident.rows).await?;
        let totals = totals(&rows);
        Ok(Totals { cost: totals[1], active: totals[3] as usize })
    }

    async fn queue_start(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<(), Halt> {
        self.settings.lambda = lambda as f32;
        self.write_settings();
        let mut encoder = self.device.encoder();
        for kernel in [kernels::DAMP, kernels::PRECONDITION, kernels::FACTOR, kernels::PCG_START] {
            self.record(&mut encoder, &[kernel], observer).await?;
        }
        self.device.submit(encoder);
        Ok(())
    }

    async fn queue_iterations(&self, count: usize, observer: &mut dyn Observer) -> Result<(), Halt> {
        let mut left = count;
        while left > 0 {
            let batch = left.min(ITERATIONS_PER_SUBMIT);
            let mut encoder = self.device.encoder();
            for _ in 0..batch {
                let iteration = [kernels::PRODUCT_POINT, kernels::PRODUCT_CAMERA, kernels::PCG_STEP];
                self.record(&mut encoder, &iteration, observer).await?;
            }
            self.device.submit(encoder);
            left -= batch;
        }
        Ok(())
    }

    /// The tried state and everything the host decides on, as if PCG were done.
    async fn queue_trial(&self, observer: &mut dyn Observer) -> Result<(), Halt> {
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        self.record(&mut encoder, &[kernels::STEP_CAMERA, kernels::STEP_POINT], observer).await?;
        resident.record(&mut encoder, &[REDUCE])?;
        self.read_back.copy(&mut encoder, &resident.shared.vectors, 0, 0, STATE_BYTES);
        let bytes = resident.rows as u64 * ROW_BYTES;
        self.read_back.copy(&mut encoder, &resident.shared.reduced, 0, STATE_BYTES, bytes);
        self.device.submit(encoder);
        Ok(())
    }

    /// Solves the linearised objective and tries the step; `None` where the solution is not finite.
    pub(super) async fn step(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<Option<Tried>, Halt> {
        self.queue_start(lambda, observer).await?;
        let mut queued = 0;
        loop {
            let batch = if queued == 0 { self.expected + SPARE_ITERATIONS } else { 2 * ITERATIONS_PER_SUBMIT };
            self.queue_iterations(batch, observer).await?;
            queued += batch;
            self.queue_trial(observer).await?;
            self.read_backs += 1;
            let read: Vec<[f32; 8]> = self.read_back.get(self.device, 1 + self.resident.rows).await?;
            let [iterations, done, _, improved, length, largest @ ..] = read[0].map(f64::from);
            if done == 0.0 && queued < self.settings.pcg.max_iterations {
                continue;
            }
            let iterations = iterations as usize;
            self.expected = iterations;
            let totals = totals(&read[1..]);
            // The damped model falls by ½xᵀ(b + r) + ½gᵀy₀; without the damping's own share it falls by more.
            let damping = lambda * (length + totals[5]);
            let predicted_decrease = 0.5 * (improved + totals[4] + damping);
            let after = Totals { cost: totals[1], active: totals[3] as usize };
            let finite = predicted_decrease.is_finite() && largest.iter().all(|value| value.is_finite());
            let tried = Tried { after, decrease: totals[0], predicted_decrease, iterations, largest };
            return Ok(finite.then_some(tried));
        }
    }

    /// Queues the tried state as the accepted one, brought into its gauge.
    pub(super) fn queue_commit(&mut self, gauge: Gauge) -> Result<(), GpuError> {
        self.settings.gauge = gauge;
        self.write_settings();
        let mut encoder = self.device.encoder();
        if gauge != Gauge::Keep {
            self.resident.record(&mut encoder, &[kernels::SAMPLE])?;
        }
        let commit = [kernels::GAUGE, kernels::COMMIT_CAMERA, kernels::COMMIT_POINT];
        self.resident.record(&mut encoder, &commit)?;
        self.device.submit(encoder);
        self.device.check()
    }
}
