//! Solves on a device that may be too weak for a problem, or go away in the middle of it: never a silent change of place.

use std::rc::Rc;

use super::Notice;
use crate::error::OptimizeError;
use crate::gpu::{Device, GpuError, Limits};
use crate::lm::{Breath, IterationRecord, LmOptions, LmReport, Observer, Places};
use crate::{bundle, positioning};

/// Below this the processor is done before a device has answered a few dozen times.
pub const MIN_OBSERVATIONS: usize = 100_000;
/// In single precision a smaller decrease is rounding (source: `solver.md` §5.7).
const MIN_TOLERANCE: f64 = 1e-7;

/// Which solves a device gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Policy {
    /// Smaller problems stay on the CPU, which is faster there, without a notice.
    pub min_observations: usize,
    /// A problem that the device cannot solve is an error instead of a [`Notice`] and a solve on the CPU. A lost device
    /// is no such problem.
    pub strict: bool,
    /// How many losses one solve survives on devices: a problem that takes the driver down does so every time.
    pub max_losses: usize,
}

impl Default for Policy {
    /// Everything on the device, the CPU where it cannot.
    fn default() -> Self {
        Self { min_observations: 0, strict: false, max_losses: 3 }
    }
}

/// A device with its policy.
///
/// Where the device is lost it opens another and goes on from the last state that was kept, or goes on on the CPU where
/// there is no other; the observer is told either way ([`Notice`]).
#[derive(Debug)]
pub struct DeviceEngine {
    /// `None` after a loss that no new device replaced.
    device: Option<Rc<Device>>,
    limits: Limits,
    policy: Policy,
    told: Vec<Notice>,
}

impl DeviceEngine {
    /// Opens the fastest adapter, a software one where there is no other.
    ///
    /// # Errors
    /// [`GpuError`] where there is no adapter or it gives no device.
    pub async fn open(limits: Limits, policy: Policy) -> Result<Self, GpuError> {
        let device = Some(Rc::new(Device::open(limits).await?));
        Ok(Self { device, limits, policy, told: Vec::new() })
    }

    /// The device, unless it was lost for good.
    pub fn device(&self) -> Option<Rc<Device>> {
        self.device.clone()
    }

    pub(super) fn description(&self) -> String {
        match &self.device {
            Some(device) => device.description().into(),
            None => "the CPU, after the GPU device was lost".into(),
        }
    }

    pub(super) async fn adjust(
        &mut self,
        problem: &mut bundle::Problem,
        options: &bundle::Options,
        observer: &mut dyn Observer,
    ) -> Result<LmReport, OptimizeError> {
        if problem.observation_px.len() < self.policy.min_observations {
            return bundle::solve_async::<f64>(problem, options, observer).await;
        }
        let mut rest = *options;
        let mut losses = 0;
        let mut done = 0;
        while let Some(device) = self.device.clone() {
            let single = bundle::Options { lm: in_single_precision(&rest.lm), ..rest };
            match bundle::gpu::solve(&device, problem, &single, &mut Later { done, observer }).await {
                Err(OptimizeError::Gpu(GpuError::Lost { reason })) => {
                    losses += 1;
                    self.replace(losses, reason, observer).await;
                }
                Err(OptimizeError::Interrupted { error: GpuError::Lost { reason }, kept }) => {
                    losses += 1;
                    if let Some(kept) = kept {
                        done += kept.iteration;
                        rest.lm.max_iterations = rest.lm.max_iterations.saturating_sub(kept.iteration).max(1);
                        rest.lm.lambda0 = kept.lambda;
                    }
                    self.replace(losses, reason, observer).await;
                }
                Err(OptimizeError::Gpu(error) | OptimizeError::Interrupted { error, .. }) => {
                    self.refused("bundle adjustment", error, observer).await?;
                    break;
                }
                solved => return solved.map(|report| after(report, done)),
            }
        }
        let solved = bundle::solve_async::<f64>(problem, &rest, &mut Later { done, observer }).await;
        solved.map(|report| after(report, done))
    }

    pub(super) async fn position(
        &mut self,
        problem: &mut positioning::Problem,
        options: &positioning::Options,
        observer: &mut dyn Observer,
    ) -> Result<positioning::Report, OptimizeError> {
        if problem.observation_image.len() < self.policy.min_observations {
            return positioning::solve_async::<f64>(problem, options, observer).await;
        }
        let mut losses = 0;
        while let Some(device) = self.device.clone() {
            // It needs no initial positions, so nothing is kept on the way: after a loss it starts again.
            match positioning::gpu::solve(&device, problem, options, observer).await {
                Err(OptimizeError::Gpu(GpuError::Lost { reason })) => {
                    losses += 1;
                    self.replace(losses, reason, observer).await;
                }
                Err(OptimizeError::Gpu(error)) => {
                    self.refused("global positioning", error, observer).await?;
                    break;
                }
                solved => return solved,
            }
        }
        positioning::solve_async::<f64>(problem, options, observer).await
    }

    /// A new device in place of a lost one, if there is one and the loss was not one too many.
    async fn replace(&mut self, losses: usize, reason: String, observer: &mut dyn Observer) {
        self.device = match losses <= self.policy.max_losses {
            true => Device::open(self.limits).await.ok().map(Rc::new),
            false => None,
        };
        let resumed_on = self.device.as_ref().map(|device| device.description().to_string());
        observer.notice(&Notice::DeviceLost { reason, resumed_on });
    }

    /// The device is there but did not solve the problem: an error, or the CPU's turn.
    pub(super) async fn refused(
        &mut self,
        what: &'static str,
        error: GpuError,
        observer: &mut dyn Observer,
    ) -> Result<(), OptimizeError> {
        if self.policy.strict {
            return Err(error.into());
        }
        // A device that failed once answers everything with that failure; the next solve deserves a fresh one.
        if self.device.as_ref().is_some_and(|device| device.check().is_err()) {
            self.device = Device::open(self.limits).await.ok().map(Rc::new);
        }
        self.tell(Notice::OnCpu { what, reason: error.to_string() }, observer);
        Ok(())
    }

    fn tell(&mut self, notice: Notice, observer: &mut dyn Observer) {
        if !self.told.contains(&notice) {
            observer.notice(&notice);
            self.told.push(notice);
        }
    }
}

/// Numbers the iterations of a resumed solve after those that were kept.
struct Later<'a> {
    done: usize,
    observer: &'a mut dyn Observer,
}

impl Observer for Later<'_> {
    fn iteration(&mut self, record: &IterationRecord) {
        self.observer.iteration(&IterationRecord { iteration: self.done + record.iteration, ..*record });
    }

    fn wants_places(&self) -> bool {
        self.observer.wants_places()
    }

    fn places(&mut self, places: &Places) {
        self.observer.places(places);
    }

    fn notice(&mut self, notice: &Notice) {
        self.observer.notice(notice);
    }

    fn should_stop(&self) -> bool {
        self.observer.should_stop()
    }

    fn interrupts(&self) -> bool {
        self.observer.interrupts()
    }

    fn heard(&mut self) {
        self.observer.heard();
    }

    fn breathe(&mut self) -> Option<Breath> {
        self.observer.breathe()
    }
}

/// The report of a resumed solve, which starts at the resumed state, counts the iterations before it.
fn after(report: LmReport, done: usize) -> LmReport {
    LmReport { iterations: done + report.iterations, ..report }
}

fn in_single_precision(lm: &LmOptions) -> LmOptions {
    LmOptions {
        relative_decrease_tolerance: lm.relative_decrease_tolerance.max(MIN_TOLERANCE),
        lambda_min: lm.lambda_min.max(LmOptions::default().lambda_min),
        ..*lm
    }
}
