//! What a person may ask of a running solve. Its own object, because the session is busy while it solves.

use std::cell::Cell;
use std::rc::Rc;

use wasm_bindgen::prelude::wasm_bindgen;

/// How far a person wants the run to go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd)]
pub(crate) enum Wish {
    #[default]
    GoOn,
    /// End early and keep what there is.
    Stop,
    /// End early and keep nothing.
    Cancel,
}

/// Shared by the page's signals and the run's observer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Wishes(Rc<Cell<Wish>>);

impl Wishes {
    pub(crate) fn get(&self) -> Wish {
        self.0.get()
    }

    pub(crate) fn set(&self, wish: Wish) {
        self.0.set(wish);
    }
}

/// Stops a run. Pausing needs nothing from here: the worker holds the run's next breath back.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Control(pub(crate) Wishes);

#[wasm_bindgen]
impl Control {
    /// Ends the run early; what is finished is kept.
    pub fn stop(&self) {
        if self.0.get() == Wish::GoOn {
            self.0.set(Wish::Stop);
        }
    }

    /// Ends the run early; nothing is kept.
    pub fn cancel(&self) {
        self.0.set(Wish::Cancel);
    }
}
