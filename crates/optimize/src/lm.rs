//! The Levenberg–Marquardt loop, written once: it sees scalars only and knows neither devices nor cameras.

use crate::engine::Notice;

/// A state's cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// `½ Σ ρ` over active observations, plus the charge of the inactive ones.
    pub cost: f64,
    /// Observations that count at present.
    pub active: usize,
}

/// A step that has been computed but not tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Decrease of the cost that the undamped quadratic model promises.
    pub predicted_decrease: f64,
    /// Products with the reduced matrix (1 for a factorisation).
    pub inner_iterations: usize,
    /// Largest |step| of an unknown in units of its column scale: the change of the residual vector it alone makes, px.
    pub max_scaled_step: f64,
}

/// What a step would do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// Cost before minus cost after, on the observations that were active before; not finite to refuse the step.
    pub decrease: f64,
}

/// A problem resident on a device. The last accepted state lives in the system, so a stopped solve loses nothing.
/// All verbs are async, for devices that answer later; nothing but scalars crosses. Those that take long breathe on the way.
#[allow(async_fn_in_trait)]
pub trait System {
    /// Decides which observations are active at the accepted state, and gives its cost.
    async fn refresh(&mut self, observer: &mut dyn Observer) -> Evaluation;
    /// Residuals, weights and derivatives at the accepted state.
    async fn linearize(&mut self, observer: &mut dyn Observer);
    /// A step at a damping relative to the diagonal of the normal equations; `None` where the system has no solution, or
    /// the observer asked to stop before there was one.
    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Option<Step>;
    /// The change of the true cost.
    async fn try_step(&mut self) -> Trial;
    /// Makes the tried state the accepted one.
    async fn accept(&mut self);
    /// Forgets the tried state.
    async fn reject(&mut self);
    /// Where everything is at the accepted state; `None` where nobody fetches it from its device.
    async fn places(&mut self) -> Option<Places> {
        None
    }
}

/// Positions in the world at some moment of a solve, by index into the problem's arrays: to be drawn, not to be relied on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places {
    /// Camera centres by image.
    pub centers: Vec<(u32, glam::DVec3)>,
    /// Points.
    pub points: Vec<(u32, glam::DVec3)>,
}

/// When to stop, and how to damp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LmOptions {
    /// At most this many steps, accepted or not.
    pub max_iterations: usize,
    /// Converged when the cost falls by less than this share on [`Self::small_decreases`] consecutive steps: 1e-7 for accuracy,
    /// 1e-5 between the rounds of a pipeline (source: `solver.md` §5.7).
    pub relative_decrease_tolerance: f64,
    /// How many consecutive accepted steps must have a small decrease. 1 does for an approximate solve.
    pub small_decreases: usize,
    /// Converged when no unknown moves by more than this in units of its column scale, px.
    pub scaled_step_tolerance: f64,
    /// First damping: Ceres' trust region radius of 1e4.
    pub lambda0: f64,
    /// Smallest damping: keeps the free gauge regular. Directions flatter than this share of the diagonal converge slowly;
    /// in `f64` 1e-12 is still safe.
    pub lambda_min: f64,
    /// Beyond this damping nothing can be gained.
    pub lambda_max: f64,
    /// Smallest gain ratio of an accepted step.
    pub accept_gain: f64,
}

impl Default for LmOptions {
    fn default() -> Self {
        Self {
            max_iterations: 50,
            relative_decrease_tolerance: 1e-6,
            small_decreases: 2,
            scaled_step_tolerance: 1e-7,
            lambda0: 1e-4,
            lambda_min: 1e-8,
            lambda_max: 1e8,
            accept_gain: 1e-4,
        }
    }
}

/// Why the loop ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// The cost no longer falls.
    CostConverged,
    /// The steps are too small to matter.
    StepConverged,
    /// No damping gives a better state.
    DampingLimit,
    /// The iterations ran out.
    MaxIterations,
    /// The observer asked to stop; the last accepted state stands.
    Stopped,
    /// No active observation, or nothing that may move.
    NothingToSolve,
}

/// One trip round the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IterationRecord {
    /// From 1.
    pub iteration: usize,
    /// Cost of the accepted state after this iteration.
    pub cost: f64,
    /// Damping that was used.
    pub lambda: f64,
    /// Actual over predicted decrease.
    pub gain: f64,
    /// Products with the reduced matrix.
    pub inner_iterations: usize,
    /// Active observations after this iteration.
    pub active: usize,
    /// Whether the step was taken.
    pub accepted: bool,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub struct LmReport {
    /// Cost at the start.
    pub initial_cost: f64,
    /// Cost at the end.
    pub final_cost: f64,
    /// Steps tried.
    pub iterations: usize,
    /// Steps taken.
    pub accepted: usize,
    /// Steps refused.
    pub rejected: usize,
    /// Products with the reduced matrix in all.
    pub inner_iterations: usize,
    /// Active observations at the end.
    pub active: usize,
    /// Why it ended.
    pub termination: Termination,
    /// Every iteration.
    pub history: Vec<IterationRecord>,
}

/// A pause that the host of a solve asks for: in a browser tab, until messages have been read.
pub type Breath = std::pin::Pin<Box<dyn Future<Output = ()>>>;

/// Watches a solve.
pub trait Observer {
    /// Called after every iteration.
    fn iteration(&mut self, _record: &IterationRecord) {}
    /// Asked after every accepted step: whether [`Self::places`] should be called.
    fn wants_places(&self) -> bool {
        false
    }
    /// Where everything is after a step.
    fn places(&mut self, _places: &Places) {}
    /// Called where a solve leaves the place it was meant for.
    fn notice(&mut self, _notice: &Notice) {}
    /// Asked before every iteration, and within one where [`Self::interrupts`].
    fn should_stop(&self) -> bool {
        false
    }
    /// Whether a person may get in between any two kernels of a device. It is then given no more at a time than it does in a
    /// moment, which costs a wait now and then, on a slow one after every kernel.
    fn interrupts(&self) -> bool {
        false
    }
    /// Told after a wait for a device in which a wish to stop would have been acted on at once.
    fn heard(&mut self) {}
    /// Asked between the parts of an iteration; what it gives is awaited before the next.
    fn breathe(&mut self) -> Option<Breath> {
        None
    }
}

/// Watches nothing.
impl Observer for () {}

/// Awaits the pause that an observer asks for, if it does.
pub async fn breath(observer: &mut dyn Observer) {
    if let Some(breath) = observer.breathe() {
        breath.await;
    }
}

/// An observer for a caller that blocks: whoever should keep the promise of a breath would wait for that caller.
pub(crate) struct Blocking<'a>(pub(crate) &'a mut dyn Observer);

impl Observer for Blocking<'_> {
    fn iteration(&mut self, record: &IterationRecord) {
        self.0.iteration(record);
    }

    fn wants_places(&self) -> bool {
        self.0.wants_places()
    }

    fn places(&mut self, places: &Places) {
        self.0.places(places);
    }

    fn notice(&mut self, notice: &Notice) {
        self.0.notice(notice);
    }

    fn should_stop(&self) -> bool {
        self.0.should_stop()
    }
}

/// Gains above this say no more about the model, and would make the cubic of Nielsen's rule leap.
const GAIN_CLIP: f64 = 1.5;
/// A promise below this share of the tolerance is as good as convergence: only rounding is left to gain.
const NEGLIGIBLE: f64 = 1e-2;

/// A fall of the cost by more than this share, most of it not the step's, is no rounding in `f32`.
const SET_CHANGE: f64 = 1e-6;

/// Minimises the cost of a system. Damping by Nielsen (1999), as in Ceres: an accepted step divides it by up to 3, each
/// refused one multiplies it by 2, 4, 8, …
pub async fn minimize<S: System>(system: &mut S, options: &LmOptions, observer: &mut dyn Observer) -> LmReport {
    let mut state = system.refresh(observer).await;
    let mut report = LmReport {
        initial_cost: state.cost,
        final_cost: state.cost,
        iterations: 0,
        accepted: 0,
        rejected: 0,
        inner_iterations: 0,
        active: state.active,
        termination: Termination::MaxIterations,
        history: Vec::new(),
    };
    if state.active == 0 {
        report.termination = Termination::NothingToSolve;
        return report;
    }
    let (mut lambda, mut factor) = (options.lambda0, 2.0);
    let mut small_decreases = 0;
    let mut linearized = false;
    while report.iterations < options.max_iterations {
        if observer.should_stop() {
            report.termination = Termination::Stopped;
            break;
        }
        if !linearized {
            system.linearize(observer).await;
            linearized = true;
            breath(observer).await;
            if observer.should_stop() {
                report.termination = Termination::Stopped;
                break;
            }
        }
        let mut record = IterationRecord {
            iteration: report.iterations + 1,
            cost: state.cost,
            lambda,
            gain: 0.0,
            inner_iterations: 0,
            active: state.active,
            accepted: false,
        };
        let mut end = None;
        let step = system.solve(lambda, observer).await;
        breath(observer).await;
        if observer.should_stop() {
            report.termination = Termination::Stopped;
            break;
        }
        report.iterations += 1;
        let mut decrease = f64::NAN;
        if let Some(step) = step {
            record.inner_iterations = step.inner_iterations;
            report.inner_iterations += step.inner_iterations;
            if step.max_scaled_step < options.scaled_step_tolerance {
                end = Some(Termination::StepConverged);
            } else if step.predicted_decrease.abs() <= NEGLIGIBLE * options.relative_decrease_tolerance * state.cost {
                end = Some(Termination::CostConverged);
            }
            decrease = system.try_step().await.decrease;
            if step.predicted_decrease > 0.0 && decrease.is_finite() {
                record.gain = decrease / step.predicted_decrease;
            }
        }
        if record.gain > options.accept_gain {
            system.accept().await;
            let before = state.cost;
            state = system.refresh(observer).await;
            linearized = false;
            report.accepted += 1;
            (record.accepted, record.cost, record.active) = (true, state.cost, state.active);
            let cubic = 1.0 - (2.0 * record.gain.min(GAIN_CLIP) - 1.0).powi(3);
            lambda = (lambda * cubic.max(1.0 / 3.0)).max(options.lambda_min);
            factor = 2.0;
            // Where the set of observations changed the cost falls by more than the step alone gave: a new problem.
            let changed = before - state.cost > options.relative_decrease_tolerance.max(SET_CHANGE) * before
                && decrease <= 0.5 * (before - state.cost);
            if changed {
                end = None;
            }
            let small = !changed && decrease <= options.relative_decrease_tolerance * before;
            small_decreases = if small { small_decreases + 1 } else { 0 };
            if small_decreases >= options.small_decreases {
                end = end.or(Some(Termination::CostConverged));
            }
            if state.active == 0 {
                end = Some(Termination::NothingToSolve);
            }
        } else {
            system.reject().await;
            report.rejected += 1;
            lambda *= factor;
            factor *= 2.0;
            if lambda > options.lambda_max {
                end = end.or(Some(Termination::DampingLimit));
            }
        }
        report.history.push(record);
        observer.iteration(&record);
        if record.accepted
            && observer.wants_places()
            && let Some(places) = system.places().await
        {
            observer.places(&places);
        }
        breath(observer).await;
        if let Some(termination) = end {
            report.termination = termination;
            break;
        }
    }
    report.final_cost = state.cost;
    report.active = state.active;
    report
}
