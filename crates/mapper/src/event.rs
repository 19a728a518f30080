//! What the pipeline tells the outside while it runs: one enum for the command line, the worker and the tests.

use epipole_optimize::lm::{Breath, Places};
use serde::Serialize;

use crate::component::Component;

/// A stage of the pipeline, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Stage {
    Calibrate,
    RelativePose,
    Rotation,
    Tracks,
    Position,
    Refine,
    Retriangulate,
    Finish,
}

impl Stage {
    /// A short name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Calibrate => "view-graph calibration",
            Self::RelativePose => "relative poses",
            Self::Rotation => "rotation averaging",
            Self::Tracks => "tracks",
            Self::Position => "global positioning",
            Self::Refine => "bundle adjustment",
            Self::Retriangulate => "retriangulation",
            Self::Finish => "finishing",
        }
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A stage begins for a component (components are numbered from 0, largest first).
    StageStarted {
        /// Which stage.
        stage: Stage,
        /// Which component; 0 for stages that see the whole graph.
        component: usize,
    },
    /// Part of a stage is done.
    Progress {
        /// Which stage.
        stage: Stage,
        /// Units done.
        done: usize,
        /// Units in all, at least `done`.
        total: usize,
    },
    /// One Levenberg–Marquardt iteration of positioning or bundle adjustment.
    Iteration {
        /// Which stage.
        stage: Stage,
        /// Counted from 1 within one solve.
        iteration: usize,
        /// ½Σρ over active observations after the iteration, in the problem's units.
        cost: f64,
        /// Damping λ.
        damping: f64,
        /// Observations in the linear system.
        active_observations: usize,
        /// Whether the step was taken.
        accepted: bool,
    },
    /// A stage ended; `seconds` is its wall time, `summary` one line of counts.
    StageFinished {
        /// Which stage.
        stage: Stage,
        /// Which component.
        component: usize,
        /// Wall time.
        seconds: f64,
        /// One line of counts for people.
        summary: String,
    },
    /// Something a person should know; the run goes on.
    Warning {
        /// What happened and what to do.
        message: String,
    },
    /// The GPU device went away in the middle of a solve, which goes on from its last kept state.
    DeviceLost {
        /// Which stage.
        stage: Stage,
        /// What the driver said.
        reason: String,
        /// The new device; `None` where the CPU took over.
        resumed_on: Option<String>,
        /// All of it in one line for people.
        message: String,
    },
    /// A component is complete.
    ComponentFinished {
        /// Its number.
        component: usize,
        /// Posed images.
        images: usize,
        /// Points.
        points: usize,
    },
}

/// Receives events and may ask the pipeline to stop.
pub trait Observer {
    /// Called on the thread that runs the pipeline.
    fn event(&mut self, event: &Event);

    /// Asked between units of work; after `true` the pipeline ends early and keeps what is finished.
    fn should_stop(&self) -> bool {
        false
    }

    /// Whether a person may want to stop or pause between any two kernels of a device ([`epipole_optimize::lm::Observer`]).
    fn interrupts(&self) -> bool {
        false
    }

    /// Told after a wait for a device in which a wish to stop would have been acted on at once.
    fn heard(&mut self) {}

    /// The component at hand after a solve or a pass, to be drawn. `complete`: it will not change any more.
    fn snapshot(&mut self, _component: &Component, _complete: bool) {}

    /// Asked between two snapshots: whether [`Self::preview`] should be called.
    fn wants_preview(&self) -> bool {
        false
    }

    /// A solve under way: the component as the solve found it, and where its images and points have got to (indices into
    /// the component's reconstruction). To be drawn; the component itself changes when the solve is over.
    fn preview(&mut self, _component: &Component, _places: &Places) {}

    /// Asked between units of work; what it gives is awaited. In a browser tab it lets messages in.
    fn breathe(&mut self) -> Option<Breath> {
        None
    }

    /// Seconds since any fixed moment, for stage times; a browser and a native program have different clocks.
    fn now_seconds(&self) -> f64 {
        0.0
    }
}

/// Awaits the pause that an observer asks for, if it does.
pub async fn breath(observer: &mut dyn Observer) {
    if let Some(breath) = observer.breathe() {
        breath.await;
    }
}

/// An observer that ignores everything.
pub struct Silent;

impl Observer for Silent {
    fn event(&mut self, _: &Event) {}
}
