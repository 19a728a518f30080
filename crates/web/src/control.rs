//! What a person may ask of a running solve. Its own object, because the session is busy while it solves.

use std::cell::Cell;
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Poll, Waker};

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
#[derive(Clone, Default)]
pub(crate) struct Wishes {
    wish: Rc<Cell<Wish>>,
    run: Rc<Cell<Option<Waker>>>,
}

impl Wishes {
    pub(crate) fn get(&self) -> Wish {
        self.wish.get()
    }

    pub(crate) fn set(&self, wish: Wish) {
        self.wish.set(wish);
        if let Some(run) = self.run.take() {
            run.wake();
        }
    }

    /// What a run gives, or `None` as soon as it is cancelled: a run that waits for a device is given up on the spot.
    pub(crate) async fn unless_cancelled<T>(&self, run: impl Future<Output = T>) -> Option<T> {
        let mut run = pin!(run);
        poll_fn(|context| {
            if self.get() == Wish::Cancel {
                return Poll::Ready(None);
            }
            self.run.set(Some(context.waker().clone()));
            run.as_mut().poll(context).map(Some)
        })
        .await
    }
}

/// Stops a run. Pausing needs nothing from here: the worker holds the run's next breath back.
#[wasm_bindgen]
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
