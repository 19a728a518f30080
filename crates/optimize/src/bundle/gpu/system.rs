//! The bundle problem resident on a GPU: queues kernels, reads scalars back.

use std::cell::Cell;

use super::checkpoint::{Checkpoint, Checkpoints};
use super::coarse::Coarse;
use super::counters::{Counters, ResidentBytes};
use super::layout::Layout;
use super::membership::{Membership, activation_word};
use super::priors::prior_cost;
use super::records::{MAX_DEPTH_SIGMAS, Params, loss_words};
use super::residency::Residency;
use super::resident::Resident;
use super::sizes::{Sizes, variant};
use crate::active::MAX_FLIPPED_SHARE;
use crate::bundle::depth::Depth;
use crate::bundle::options::Options;
use crate::bundle::problem::Problem;
use crate::error::OptimizeError;
use crate::gpu::sums::{ROW_BYTES, totals};
use crate::gpu::{Device, Failure, GpuError, Halt, ReadBack, Turns};
use crate::lm::{Evaluation, Observer, Places, Step, System, Trial};

/// Accepted steps between two evaluations of the residuals from scratch (source: `solver.md` §5.5).
const RESIDUAL_REFRESH: usize = 10;
/// PCG iterations in one submission at most (source: `solver.md` §2.5).
const ITERATIONS_PER_SUBMIT: usize = 8;
/// Observations times iterations in one submission: at 60 bytes each and the 20 GB/s of a slow device 0.12 s, where
/// drivers give up after 2 s.
const WORK_PER_SUBMIT: usize = 40_000_000;
/// PCG iterations queued beyond those of the last step, before the host asks whether they were enough. Where they were
/// not, this many more are queued: those after the stop are empty dispatches, cheaper than to ask again.
const SPARE_ITERATIONS: usize = 4;
const MORE_ITERATIONS: usize = 100;
/// Kernels of a PCG iteration.
const KERNELS_PER_ITERATION: usize = 3;
/// Bytes that an observation moves in a product, and products that a step is worth beside those of PCG
/// (source: `solver.md` §6).
const PRODUCT_BYTES: f64 = 60.0;
const FIXED_PRODUCTS: f64 = 6.0;
/// Bytes of PCG state that are read back.
const STATE_BYTES: u64 = 32;

/// A bundle adjustment problem on a GPU.
#[derive(Debug)]
pub struct GpuSystem<'a> {
    device: &'a Device,
    pub(super) layout: Layout,
    pub(super) resident: Resident,
    pub(super) coarse: Coarse,
    read_back: ReadBack,
    failure: Failure,
    evaluation: Option<Evaluation>,
    after: Evaluation,
    trial: Trial,
    accepted: usize,
    pub(super) membership: Membership,
    /// Of the priors on camera parameters, at the accepted state and at the tried one.
    prior_cost: f64,
    prior_cost_after: f64,
    /// Iterations of the last solve: what to queue for the next.
    expected: usize,
    max_iterations: usize,
    /// The LM iteration under way, from 1, and its damping.
    iteration: usize,
    lambda: f64,
    /// Whether a state was accepted and no copy of it asked for yet.
    is_unsaved: bool,
    /// The LM iteration whose state an observer saw last.
    drawn: usize,
    pub(super) checkpoints: Checkpoints,
    counters: Cell<Counters>,
    turns: Turns,
}

/// Whether what is known of depths has squares in `f32`.
fn fits_single_precision(depth: &Depth) -> bool {
    depth.inverse.iter().chain(&depth.weight).all(|&v| v <= f64::from(MAX_DEPTH_SIGMAS))
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
        if !problem.depth.iter().all(fits_single_precision) {
            return Err(GpuError::Unsupported { what: "a depth or inverse depth of more than 1e15" }.into());
        }
        let limits = residency.limits(device, Sizes::of(variant(problem)));
        let layout = Layout::new(problem, options, limits)?;
        let coarse = Coarse::new(device, &layout.plan, options)?;
        let pcg = options.pcg;
        let params = Params {
            loss: loss_words(problem.loss),
            depth_loss: loss_words(layout.depth_loss),
            activation: activation_word(options.activation),
            fixed_points: problem.fixed_points,
            eta: pcg.eta as f32,
            iterations: (pcg.min_iterations as u32, pcg.max_iterations as u32),
            ..Params::default()
        };
        let resident = Resident::new(device, &layout, params)?;
        let rows = resident.reduced;
        let read_back = device.read_back("scalars", STATE_BYTES + 2 * rows * ROW_BYTES)?;
        let checkpoints = Checkpoints::new(device, &layout)?;
        let none = Evaluation { cost: 0.0, active: 0 };
        Ok(Self {
            device,
            layout,
            resident,
            coarse,
            read_back,
            failure: Failure::default(),
            evaluation: None,
            after: none,
            trial: Trial { decrease: f64::NAN },
            accepted: 0,
            membership: Membership::new(options.activation, problem.loss),
            prior_cost: prior_cost(problem),
            prior_cost_after: 0.0,
            expected: ITERATIONS_PER_SUBMIT,
            max_iterations: pcg.max_iterations,
            iteration: 0,
            lambda: 0.0,
            is_unsaved: false,
            drawn: 0,
            checkpoints,
            counters: Cell::default(),
            turns: Turns::default(),
        })
    }

    pub(super) fn device(&self) -> &Device {
        self.device
    }

    /// Bytes on the device.
    pub fn resident_bytes(&self) -> ResidentBytes {
        ResidentBytes { staging_bytes: self.checkpoints.bytes(), ..self.resident.bytes() }
    }

    /// Of the priors on camera parameters at the accepted state.
    pub(super) fn prior_cost(&self) -> f64 {
        self.prior_cost
    }

    /// What has been asked of the device so far.
    pub fn counters(&self) -> Counters {
        let counters = self.counters.get();
        let submissions = counters.submissions + self.turns.taken();
        Counters { dispatches: self.resident.dispatches(), submissions, ..counters }
    }

    fn count(&self, change: impl FnOnce(&mut Counters)) {
        let mut counters = self.counters.get();
        change(&mut counters);
        self.counters.set(counters);
    }

    fn submit(&self, encoder: wgpu::CommandEncoder) {
        self.count(|c| c.submissions += 1);
        self.device.submit(encoder);
    }

    pub(super) fn failure(&self) -> Failure {
        self.failure.clone()
    }

    /// Keeps the first failure; the loop then sees a step without a solution and the observer's wish to stop.
    fn kept<T>(&self, result: Result<T, impl Into<Halt>>) -> Option<T> {
        self.failure.keep(result)
    }

    fn observations(&self) -> usize {
        self.resident.params.observations as usize
    }

    /// Records a kernel over all observations, the last of a turn where that is due.
    async fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        observer: &mut dyn Observer,
    ) -> Result<(), Halt> {
        self.resident.record(encoder, name)?;
        self.turns.take(self.device, encoder, self.observations(), observer).await
    }

    /// The same where the state is between two accepted ones: the solve cannot end here, only pause.
    pub(super) async fn record_through(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        observer: &mut dyn Observer,
    ) -> Result<(), GpuError> {
        self.resident.record(encoder, name)?;
        self.turns.rest(self.device, encoder, self.observations(), observer).await
    }

    /// Sums of a kernel over points that has just been recorded.
    pub(super) async fn totals_of(&mut self, mut encoder: wgpu::CommandEncoder) -> Result<[f64; 8], GpuError> {
        let resident = &self.resident;
        resident.record(&mut encoder, "reduce trial")?;
        let bytes = resident.reduced * ROW_BYTES;
        self.read_back.copy(&mut encoder, &resident.buffers.trial_reduced, 0, 0, bytes);
        self.submit(encoder);
        self.count(|c| c.read_backs += 1);
        let rows: Vec<[f32; 8]> = self.read_back.get(self.device, resident.reduced as usize).await?;
        Ok(totals(&rows))
    }

    async fn evaluate(&mut self, observer: &mut dyn Observer) -> Result<Evaluation, GpuError> {
        let mut encoder = self.device.encoder();
        self.record_through(&mut encoder, "refresh", observer).await?;
        let totals = self.totals_of(encoder).await?;
        Ok(Evaluation { cost: 0.5 * totals[1] + self.prior_cost, active: totals[3] as usize })
    }

    async fn queue_linearization(&mut self, observer: &mut dyn Observer) -> Result<(), Halt> {
        let mut encoder = self.device.encoder();
        self.record(&mut encoder, "reweight", observer).await?;
        self.queue_compaction(&mut encoder)?;
        for name in ["linearize_point", "linearize_camera", "scale_camera"] {
            self.record(&mut encoder, name, observer).await?;
        }
        self.submit(encoder);
        Ok(self.device.check()?)
    }

    pub(super) async fn queue_start(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<(), Halt> {
        self.resident.params.lambda = lambda as f32;
        self.resident.write_params(self.device);
        let mut encoder = self.device.encoder();
        for name in ["damp_point", "precondition_camera", "precondition_group", "precondition_factor"] {
            self.record(&mut encoder, name, observer).await?;
        }
        if self.coarse.is_due(self.accepted) {
            self.submit(encoder);
            self.count(|c| c.read_backs += 1);
            let submitted = || self.count(|c| c.submissions += 1);
            let (resident, chunks) = (&self.resident, &self.layout.chunks);
            self.coarse.assemble(self.device, resident, chunks, submitted, &self.turns, observer).await?;
            encoder = self.device.encoder();
        }
        self.record(&mut encoder, "pcg_start", observer).await?;
        self.submit(encoder);
        Ok(())
    }

    async fn queue_iterations(&self, count: usize, observer: &mut dyn Observer) -> Result<(), Halt> {
        let resident = &self.resident;
        let observations = self.observations();
        let bearable = WORK_PER_SUBMIT / observations.max(1);
        let before = resident.dispatches();
        let mut left = count;
        while left > 0 {
            let batch = left.min(bearable.clamp(1, ITERATIONS_PER_SUBMIT));
            let mut encoder = self.device.encoder();
            for _ in 0..batch {
                resident.record_by_chunk(&mut encoder, &["product_point", "product_camera"])?;
                resident.record(&mut encoder, "pcg_step")?;
                // Its three kernels are a turn together: as short as any of those that stand alone.
                self.turns.take(self.device, &mut encoder, KERNELS_PER_ITERATION * observations, observer).await?;
            }
            self.submit(encoder);
            left -= batch;
        }
        self.count(|c| {
            c.pcg_iterations += count as u64;
            c.pcg_dispatches += resident.dispatches() - before;
        });
        Ok(())
    }

    /// The tried state and everything the host decides on, as if PCG were done.
    async fn queue_trial(&self, observer: &mut dyn Observer) -> Result<(), Halt> {
        let resident = &self.resident;
        let mut encoder = self.device.encoder();
        resident.record(&mut encoder, "step_camera")?;
        resident.record(&mut encoder, "change_camera")?;
        if self.layout.priors.any {
            resident.record(&mut encoder, "prior_camera")?;
        }
        for name in ["back_substitute", "change_point", "trial"] {
            self.record(&mut encoder, name, observer).await?;
        }
        resident.record(&mut encoder, "reduce step")?;
        resident.record(&mut encoder, "reduce trial")?;
        let bytes = resident.reduced * ROW_BYTES;
        let buffers = &resident.buffers;
        self.read_back.copy(&mut encoder, &buffers.vectors, 0, 0, STATE_BYTES);
        self.read_back.copy(&mut encoder, &buffers.step_reduced, 0, STATE_BYTES, bytes);
        self.read_back.copy(&mut encoder, &buffers.trial_reduced, 0, STATE_BYTES + bytes, bytes);
        self.submit(encoder);
        Ok(())
    }

    async fn compute_step(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<Option<Step>, Halt> {
        self.queue_start(lambda, observer).await?;
        let rows = self.resident.reduced as usize;
        let mut queued = 0;
        loop {
            let first = (self.expected + SPARE_ITERATIONS).min(self.max_iterations);
            let batch = if queued == 0 { first } else { (self.max_iterations - queued).min(MORE_ITERATIONS) };
            self.queue_iterations(batch, observer).await?;
            queued += batch;
            self.queue_trial(observer).await?;
            self.count(|c| c.read_backs += 1);
            let read: Vec<[f32; 8]> = self.read_back.get(self.device, 1 + 2 * rows).await?;
            let [iterations, done, _, improved, length, largest, prior_decrease, prior_cost] = read[0].map(f64::from);
            if done == 0.0 && queued < self.max_iterations {
                continue;
            }
            self.checkpoints.harvest(&self.layout)?;
            self.checkpoints
                .earn(PRODUCT_BYTES * f64::from(self.resident.params.observations) * (iterations + FIXED_PRODUCTS));
            self.expected = iterations as usize;
            self.coarse.took(iterations as usize, self.max_iterations);
            let step = totals(&read[1..=rows]);
            let trial = totals(&read[1 + rows..]);
            let flipped_share = trial[2] / (trial[2] + trial[3]).max(1.0);
            let refused = flipped_share > MAX_FLIPPED_SHARE;
            self.membership.tried = (trial[4], trial[3] as usize);
            self.trial = Trial { decrease: if refused { f64::NAN } else { prior_decrease - 0.5 * trial[0] } };
            self.prior_cost_after = if self.layout.priors.any { prior_cost + self.layout.priors.constant } else { 0.0 };
            self.after = Evaluation { cost: 0.5 * trial[1] + self.prior_cost_after, active: trial[3] as usize };
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
        self.submit(encoder);
        self.device.check()
    }
}

impl GpuSystem<'_> {
    /// Sends a copy of the accepted state to the host; nothing waits for it.
    fn keep_state(&mut self, cost: f64) {
        if self.checkpoints.is_due() {
            let state = Checkpoint { iteration: self.iteration, cost, lambda: self.lambda };
            self.checkpoints.start(self.device, &self.layout, &self.resident, state);
            self.count(|c| {
                c.submissions += 1;
                c.checkpoints += 1;
            });
        }
    }
}

impl System for GpuSystem<'_> {
    async fn refresh(&mut self, observer: &mut dyn Observer) -> Evaluation {
        let evaluation = match self.evaluation {
            _ if self.membership.may_return() => {
                let evaluation = self.decide(observer).await;
                self.kept(evaluation).unwrap_or(self.after)
            }
            Some(evaluation) => evaluation,
            None => {
                let evaluation = self.evaluate(observer).await;
                self.kept(evaluation).unwrap_or(self.after)
            }
        };
        self.evaluation = Some(evaluation);
        if std::mem::take(&mut self.is_unsaved) && self.failure.get().is_none() {
            self.keep_state(evaluation.cost);
        }
        evaluation
    }

    async fn linearize(&mut self, observer: &mut dyn Observer) {
        let queued = self.queue_linearization(observer).await;
        self.kept(queued);
    }

    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Option<Step> {
        self.trial = Trial { decrease: f64::NAN };
        if self.failure.get().is_some() {
            return None;
        }
        (self.iteration, self.lambda) = (self.iteration + 1, lambda);
        self.count(|c| c.steps += 1);
        let step = self.compute_step(lambda, observer).await;
        self.kept(step).flatten()
    }

    async fn try_step(&mut self) -> Trial {
        self.trial
    }

    async fn accept(&mut self) {
        if self.kept(self.queue_commit()).is_some() {
            self.accepted += 1;
            self.prior_cost = self.prior_cost_after;
            self.membership.accept();
            // From scratch now and then: the next refresh asks the device.
            let due = self.accepted.is_multiple_of(RESIDUAL_REFRESH);
            self.membership.from_scratch = due;
            self.evaluation = (!due).then_some(self.after);
            self.is_unsaved = true;
        }
    }

    async fn reject(&mut self) {}

    /// From the copies of accepted states that are made anyway: a step or a few behind, and nothing waits for it.
    async fn places(&mut self) -> Option<Places> {
        let harvested = self.checkpoints.harvest(&self.layout);
        self.kept(harvested)?;
        let (checkpoint, state) = self.checkpoints.last()?;
        let iteration = checkpoint.iteration;
        let places = (iteration > self.drawn).then(|| self.places_in(state));
        self.drawn = iteration;
        places
    }
}
