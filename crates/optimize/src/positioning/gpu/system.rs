//! Variable projection as a system of the Levenberg–Marquardt loop, on a GPU.

use super::processor::{Gpu, Totals};
use super::records::Gauge;
use crate::gpu::Failure;
use crate::lm::{Evaluation, Observer, Places, Step, System, Trial};

/// The problem while the loop drives it. The objective is `½ Σ ω ρ(‖v − s d‖²)` over all observations that take part.
pub(super) struct Projection<'g, 'a> {
    gpu: &'g mut Gpu<'a>,
    failure: Failure,
    evaluation: Option<Evaluation>,
    after: Evaluation,
    decrease: f64,
    linearized: bool,
}

impl<'g, 'a> Projection<'g, 'a> {
    pub(super) fn new(gpu: &'g mut Gpu<'a>, failure: Failure) -> Self {
        let none = Evaluation { cost: 0.0, active: 0 };
        Self { gpu, failure, evaluation: None, after: none, decrease: f64::NAN, linearized: false }
    }
}

impl From<Totals> for Evaluation {
    fn from(totals: Totals) -> Self {
        Self { cost: totals.cost, active: totals.active }
    }
}

impl System for Projection<'_, '_> {
    async fn refresh(&mut self, observer: &mut dyn Observer) -> Evaluation {
        if let Some(evaluation) = self.evaluation {
            return evaluation;
        }
        let totals = self.gpu.linearize(observer).await;
        let evaluation = self.failure.keep(totals).map_or(self.after, Evaluation::from);
        self.linearized = true;
        self.evaluation = Some(evaluation);
        evaluation
    }

    async fn linearize(&mut self, observer: &mut dyn Observer) {
        if !self.linearized {
            let queued = self.gpu.queue_linearization(observer).await;
            self.failure.keep(queued);
            self.linearized = true;
        }
    }

    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Option<Step> {
        self.decrease = f64::NAN;
        if self.failure.get().is_some() {
            return None;
        }
        let tried = self.gpu.step(lambda, observer).await;
        let tried = self.failure.keep(tried).flatten()?;
        self.decrease = tried.decrease;
        self.after = tried.after.into();
        let [max_scaled_step, ..] = tried.largest;
        let inner_iterations = tried.iterations.max(1);
        Some(Step { predicted_decrease: tried.predicted_decrease, inner_iterations, max_scaled_step })
    }

    async fn try_step(&mut self) -> Trial {
        Trial { decrease: self.decrease }
    }

    async fn accept(&mut self) {
        if self.failure.keep(self.gpu.queue_commit(Gauge::Follow)).is_some() {
            self.evaluation = Some(self.after);
            self.linearized = false;
        }
    }

    async fn reject(&mut self) {}

    async fn places(&mut self) -> Option<Places> {
        let positions = self.gpu.download().await;
        self.failure.keep(positions).map(|positions| positions.places(self.gpu.layout))
    }
}
