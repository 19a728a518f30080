//! The stages of positioning on a GPU: convex starts, variable projection, positions in and out.

use super::processor::Gpu;
use super::records::{Gauge, Stage};
use super::system::Projection;
use crate::error::OptimizeError;
use crate::gpu::{Failure, Guard, Halt};
use crate::lm::{LmOptions, LmReport, Observer, minimize};
use crate::positioning::backend::{Backend, ConvexStep, Objective};
use crate::positioning::gauge::Positions;
use crate::positioning::layout::Rays;
use crate::positioning::options::Options;

/// Steps below this are rounding in `f32`: a unit ray is good to 6e-8, and a centre's step is measured by the length of
/// the residual vector's change, over some hundred rays.
const STEP_TOLERANCE: f64 = 1e-6;

impl Backend for Gpu<'_> {
    type Scalar = f32;

    async fn begin(&mut self, objective: Objective, observer: &mut dyn Observer) -> Result<f64, OptimizeError> {
        match objective {
            Objective::EqualScales { free_scale, huber } => {
                self.settings.stage = Stage::EqualScales;
                self.settings.bound = free_scale as f32;
                self.settings.huber = huber as f32;
                self.settings.huber_pinned = huber as f32;
                self.upload(&Positions::origin(self.layout));
            }
            Objective::Lud { bound, delta } => {
                self.settings.stage = Stage::Lud;
                self.settings.bound = bound as f32;
                self.settings.delta = delta as f32;
            }
        }
        Ok(self.linearize(observer).await?.cost)
    }

    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<Option<ConvexStep>, OptimizeError> {
        match self.convex_step(lambda, observer).await {
            Ok(step) => Ok(step),
            Err(Halt::Stopped) => Ok(None),
            Err(failed) => Err(failed.into()),
        }
    }

    async fn project(
        &mut self,
        rays: &Rays<f32>,
        options: &Options,
        observer: &mut dyn Observer,
    ) -> Result<LmReport, OptimizeError> {
        let clipped = rays.weight.contains(&0.0);
        if clipped || self.clipped {
            self.write_rays(rays);
            self.clipped = clipped;
        }
        self.settings.stage = Stage::Project;
        self.settings.huber = options.huber as f32;
        self.settings.huber_pinned = options.huber_pinned as f32;
        self.settings.bound = options.min_scale as f32;
        self.queue_commit(Gauge::Start)?;
        let scaled_step_tolerance = options.lm.scaled_step_tolerance.max(STEP_TOLERANCE);
        let lm = LmOptions { scaled_step_tolerance, ..options.lm };
        let failure = Failure::default();
        let mut guard = Guard { inner: observer, failure: failure.clone() };
        let mut system = Projection::new(self, failure.clone());
        let report = minimize(&mut system, &lm, &mut guard).await;
        match failure.get() {
            Some(error) => Err(error.into()),
            None => Ok(report),
        }
    }

    async fn positions(&mut self) -> Result<Positions<f32>, OptimizeError> {
        Ok(self.download().await?)
    }

    fn place(&mut self, positions: &Positions<f32>) {
        self.upload(positions);
    }
}

impl Gpu<'_> {
    async fn convex_step(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<Option<ConvexStep>, Halt> {
        let Some(tried) = self.step(lambda, observer).await? else { return Ok(None) };
        self.queue_commit(Gauge::Keep)?;
        let [_, moved, extent] = tried.largest;
        // What is left out if a person stops here belongs to the next step.
        self.queue_linearization(observer).await?;
        Ok(Some(ConvexStep { cost: tried.after.cost, inner_iterations: tried.iterations, moved, extent }))
    }
}
