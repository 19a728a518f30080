//! Where a failure of the device goes in the middle of a solve, whose verbs return scalars only.

use std::cell::RefCell;
use std::rc::Rc;

use super::error::GpuError;
use super::turns::Halt;
use crate::engine::Notice;
use crate::lm::{Breath, IterationRecord, Observer, Places};

/// The first failure, shared by a system and the observer that stops its loop.
#[derive(Clone, Debug, Default)]
pub(crate) struct Failure(Rc<RefCell<Option<GpuError>>>);

impl Failure {
    /// Passes a value on; an error is kept, unless an earlier one is. A wish to stop is no failure.
    pub(crate) fn keep<T>(&self, result: Result<T, impl Into<Halt>>) -> Option<T> {
        match result.map_err(Into::into) {
            Ok(value) => Some(value),
            Err(Halt::Stopped) => None,
            Err(Halt::Failed(error)) => {
                self.0.borrow_mut().get_or_insert(error);
                None
            }
        }
    }

    /// What was kept.
    pub(crate) fn get(&self) -> Option<GpuError> {
        self.0.borrow().clone()
    }
}

/// An observer that also stops the loop when the device fails.
pub(crate) struct Guard<'a> {
    pub(crate) inner: &'a mut dyn Observer,
    pub(crate) failure: Failure,
}

impl Observer for Guard<'_> {
    fn iteration(&mut self, record: &IterationRecord) {
        self.inner.iteration(record);
    }

    fn wants_places(&self) -> bool {
        self.inner.wants_places()
    }

    fn places(&mut self, places: &Places) {
        self.inner.places(places);
    }

    fn notice(&mut self, notice: &Notice) {
        self.inner.notice(notice);
    }

    fn breathe(&mut self) -> Option<Breath> {
        self.inner.breathe()
    }

    fn interrupts(&self) -> bool {
        self.inner.interrupts()
    }

    fn heard(&mut self) {
        self.inner.heard();
    }

    fn should_stop(&self) -> bool {
        self.failure.get().is_some() || self.inner.should_stop()
    }
}
