//! The bundle problem resident on a GPU: queues kernels, reads scalars back.

use std::cell::RefCell;
use std::rc::Rc;

use super::buffers::ROW_BYTES;
use super::layout::Layout;
use super::records::{Params, loss_words};
use super::residency::Residency;
use super::resident::Resident;
use crate::active::Activation;
use crate::bundle::options::Options;
use crate::bundle::problem::Problem;
use crate::error::OptimizeError;
use crate::gpu::{Device, GpuError, ReadBack};
use crate::lm::{Evaluation, Step, System, Trial};

/// Accepted steps between two evaluations of the residuals from scratch (source: `solver.md` §5.5).
const RESIDUAL_REFRESH: usize = 10;
/// PCG iterations in one submission: bounds its time on slow devices (source: `solver.md` §2.5).
const ITERATIONS_PER_SUBMIT: usize = 8;
/// PCG iterations queued beyond those of the last step, before the host asks whether they were enough; iterations after
/// the stop cost a few empty dispatches.
const SPARE_ITERATIONS: usize = 4;
/// A trial that would throw more than this share of the observations behind cameras is refused, as on the CPU.
const MAX_FLIPPED_SHARE: f64 = 0.01;
/// Bytes of PCG state that are read back.
const STATE_BYTES: u64 = 32;

/// Where a failure of the device is left: the verbs of [`System`] return scalars only.
pub(super) type Failure = Rc<RefCell<Option<GpuError>>>;

/// A bundle adjustment problem on a GPU.
#[derive(Debug)]
pub struct GpuSystem<'a> {
    device: &'a Device,
    pub(super) layout: Layout,
    pub(super) resident: Resident,
    read_back: ReadBack,
    failure: Failure,
    evaluation: Option<Evaluation>,
    after: Evaluation,
    trial: Trial,
    accepted: usize,
    /// Iterations of the last solve: what to queue for the next.
    expected: usize,
    max_iterations: usize,
    pub(super) read_backs: usize,
}

impl<'a> GpuSystem<'a> {
    /// Checks a problem and makes it resident.
    pub fn new(device: &'a Device, problem: &Problem, options: &Options) -> Result<Self, OptimizeError> {
        Self::with_residency(device, problem, options, &Residency::default())
    }

    /// [`Self::new`] with a say in how the problem lies on the device.
    pub fn with_residency(
        device: &'a Device,
        problem: &Problem,
        options: &Options,
        residency: &Residency,
    ) -> Result<Self, OptimizeError> {
        problem.validate()?;
        let check_depth = match options.activation {
            Activation::ValidAtStart => true,
            Activation::All => false,
            Activation::Truncated { .. } => {
                return Err(GpuError::Unsupported { what: "the truncated objective" }.into());
            }
        };
        let layout = Layout::new(problem, residency.limits(device))?;
        let pcg = options.pcg;
        let params = Params {
            loss: loss_words(problem.loss),
            check_depth,
            fixed_points: problem.fixed_points,
            eta: pcg.eta as f32,
            iterations: (pcg.min_iterations as u32, pcg.max_iterations as u32),
            ..Params::default()
        };
        let resident = Resident::new(device, &layout, params)?;
        let rows = resident.reduced;
        let read_back = device.read_back("scalars", STATE_BYTES + 2 * rows * ROW_BYTES)?;
        let none = Evaluation { cost: 0.0, active: 0 };
        Ok(Self {
            device,
            layout,
            resident,
            read_back,
            failure: Failure::default(),
            evaluation: None,
            after: none,
            trial: Trial { decrease: f64::NAN },
            accepted: 0,
            expected: ITERATIONS_PER_SUBMIT,
            max_iterations: pcg.max_iterations,
            read_backs: 0,
        })
    }

    pub(super) fn device(&self) -> &Device {
        self.device
    }

    /// Bytes on the device.
    pub fn resident_bytes(&self) -> u64 {
        self.resident.bytes()
    }

    pub(super) fn failure(&self) -> Failure {
        self.failure.clone()
    }

    /// Keeps the first failure; the loop then sees a step without a solution and the observer's wish to stop.
    fn kept<T>(&self, result: Result<T, GpuError>) -> Option<T> {
        result.map_err(|error| self.failure.borrow_mut().get_or_insert(error).clone()).ok()
    }

    /// Sums of the columns of rows (eighth: maximum), in `f64`.
    fn totals(rows: &[[f32; 8]]) -> [f64; 8] {
        rows.iter().fold([0.0; 8], |mut sum, row| {
            (0..7).for_each(|k| sum[k] += f64::from(row[k]));
            sum[7] = sum[7].max(f64::from(row[7]));
            sum
        })
    }

    async fn evaluate(&mut self) -> Result<Evaluation, GpuError> {
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        resident.record(&mut encoder, "refresh")?;
        resident.record(&mut encoder, "reduce trial")?;
        let bytes = resident.reduced * ROW_BYTES;
        self.read_back.copy(&mut encoder, &resident.buffers.trial_reduced, 0, 0, bytes);
        self.device.submit(encoder);
        self.read_backs += 1;
        let rows: Vec<[f32; 8]> = self.read_back.get(self.device, resident.reduced as usize).await?;
        let totals = Self::totals(&rows);
        Ok(Evaluation { cost: 0.5 * totals[1], active: totals[3] as usize })
    }

    fn queue_linearization(&self) -> Result<(), GpuError> {
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        resident.record(&mut encoder, "reweight")?;
        resident.record(&mut encoder, "linearize_point")?;
        resident.record(&mut encoder, "linearize_camera")?;
        resident.record(&mut encoder, "scale_camera")?;
        self.device.submit(encoder);
        self.device.check()
    }

    fn queue_start(&mut self, lambda: f64) -> Result<(), GpuError> {
        self.resident.params.lambda = lambda as f32;
        self.resident.write_params(self.device);
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        resident.record(&mut encoder, "damp_point")?;
        resident.record(&mut encoder, "precondition_camera")?;
        resident.record(&mut encoder, "precondition_factor")?;
        resident.record(&mut encoder, "pcg_start")?;
        self.device.submit(encoder);
        Ok(())
    }

    fn queue_iterations(&self, count: usize) -> Result<(), GpuError> {
        let resident = &self.resident;
        let mut left = count;
        while left > 0 {
            let batch = left.min(ITERATIONS_PER_SUBMIT);
            let mut encoder = self.device.encoder();
            for _ in 0..batch {
                resident.record_by_chunk(&mut encoder, &["product_point", "product_camera"])?;
                resident.record(&mut encoder, "pcg_step")?;
            }
            self.device.submit(encoder);
            left -= batch;
        }
        Ok(())
    }

    /// The tried state and everything the host decides on, as if PCG were done.
    fn queue_trial(&self) -> Result<(), GpuError> {
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        resident.record(&mut encoder, "step_camera")?;
        resident.record(&mut encoder, "change_camera")?;
        resident.record(&mut encoder, "back_substitute")?;
        resident.record(&mut encoder, "change_point")?;
        resident.record(&mut encoder, "trial")?;
        resident.record(&mut encoder, "reduce step")?;
        resident.record(&mut encoder, "reduce trial")?;
        let bytes = resident.reduced * ROW_BYTES;
        let buffers = &resident.buffers;
        self.read_back.copy(&mut encoder, &buffers.vectors, 0, 0, STATE_BYTES);
        self.read_back.copy(&mut encoder, &buffers.step_reduced, 0, STATE_BYTES, bytes);
        self.read_back.copy(&mut encoder, &buffers.trial_reduced, 0, STATE_BYTES + bytes, bytes);
        self.device.submit(encoder);
        Ok(())
    }

    async fn compute_step(&mut self, lambda: f64) -> Result<Option<Step>, GpuError> {
        self.queue_start(lambda)?;
        let rows = self.resident.reduced as usize;
        let mut queued = 0;
        loop {
            let batch = if queued == 0 { self.expected + SPARE_ITERATIONS } else { 2 * ITERATIONS_PER_SUBMIT };
            self.queue_iterations(batch)?;
            queued += batch;
            self.queue_trial()?;
            self.read_backs += 1;
            let read: Vec<[f32; 8]> = self.read_back.get(self.device, 1 + 2 * rows).await?;
            let [iterations, done, _, improved, length, largest, ..] = read[0].map(f64::from);
            if done == 0.0 && queued < self.max_iterations {
                continue;
            }
            self.expected = iterations as usize;
            let step = Self::totals(&read[1..=rows]);
            let trial = Self::totals(&read[1 + rows..]);
            let flipped_share = trial[2] / (trial[2] + trial[3]).max(1.0);
            let refused = flipped_share > MAX_FLIPPED_SHARE;
            self.trial = Trial { decrease: if refused { f64::NAN } else { -0.5 * trial[0] } };
            self.after = Evaluation { cost: 0.5 * trial[1], active: trial[3] as usize };
            // The damped model falls by ½xᵀ(b + r) + ½gᵀy₀; without the damping's own share it falls by more.
            let damping = lambda * (length + step[0]);
            let predicted_decrease = 0.5 * (improved + step[1] + damping);
            let max_scaled_step = largest.max(step[7]);
            let finite = predicted_decrease.is_finite() && max_scaled_step.is_finite();
            let inner_iterations = iterations as usize;
            return Ok(finite.then_some(Step { predicted_decrease, inner_iterations, max_scaled_step }));
        }
    }

    fn queue_commit(&self) -> Result<(), GpuError> {
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        resident.record(&mut encoder, "commit_camera")?;
        resident.record(&mut encoder, "commit_point")?;
        self.device.submit(encoder);
        self.device.check()
    }
}

impl System for GpuSystem<'_> {
    async fn refresh(&mut self) -> Evaluation {
        if let Some(evaluation) = self.evaluation {
            return evaluation;
        }
        let evaluation = self.evaluate().await;
        let evaluation = self.kept(evaluation).unwrap_or(self.after);
        self.evaluation = Some(evaluation);
        evaluation
    }

    async fn linearize(&mut self) {
        self.kept(self.queue_linearization());
    }

    async fn solve(&mut self, lambda: f64) -> Option<Step> {
        self.trial = Trial { decrease: f64::NAN };
        if self.failure.borrow().is_some() {
            return None;
        }
        let step = self.compute_step(lambda).await;
        self.kept(step).flatten()
    }

    async fn try_step(&mut self) -> Trial {
        self.trial
    }

    async fn accept(&mut self) {
        if self.kept(self.queue_commit()).is_some() {
            self.accepted += 1;
            // From scratch now and then: the next refresh asks the device.
            let due = self.accepted.is_multiple_of(RESIDUAL_REFRESH);
            self.evaluation = (!due).then_some(self.after);
        }
    }

    async fn reject(&mut self) {}
}
