//! How long a run keeps a person waiting: measured in every run, because no test machine is a visitor's.

use std::cell::Cell;
use std::rc::Rc;

use epipole_mapper::Stage;

use crate::observer::now;

/// How long a run went without looking at its wishes: what a person has to wait for an answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Deafness(Rc<Cell<Gap>>);

#[derive(Clone, Copy, Debug, Default)]
struct Gap {
    listened: f64,
    longest: f64,
    stage: Option<Stage>,
}

impl Deafness {
    /// Starts anew.
    pub(crate) fn begin(&self) {
        self.0.set(Gap { listened: now(), ..Gap::default() });
    }

    /// Called where the run could breathe, and when it has.
    pub(crate) fn listen(&self, stage: Stage) {
        let (now, mut gap) = (now(), self.0.get());
        if now - gap.listened > gap.longest {
            (gap.longest, gap.stage) = (now - gap.listened, Some(stage));
        }
        gap.listened = now;
        self.0.set(gap);
    }

    /// Time spent waiting does not count.
    pub(crate) fn resume(&self) {
        self.0.set(Gap { listened: now(), ..self.0.get() });
    }

    /// Seconds, and in which stage.
    pub(crate) fn longest(&self) -> (f64, Option<Stage>) {
        (self.0.get().longest, self.0.get().stage)
    }
}
