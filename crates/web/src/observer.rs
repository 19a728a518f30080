//! Passes the run's events on to the page, and lets the page in between iterations.

use epipole_mapper::{Component, Event, Observer, Stage};
use epipole_optimize::lm::{Breath, Places};
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;

use crate::control::{Wish, Wishes};
use crate::deafness::Deafness;
use crate::host::Host;
use crate::session::to_js;
use crate::snapshot::Arrays;

/// Pictures a second at most: more cannot be told apart, and each is copied.
const SNAPSHOT_SECONDS: f64 = 0.1;
/// Longest time between two breaths: a wish is answered within 200 ms (issue 5), and each breath costs a message.
const BREATH_SECONDS: f64 = 0.05;
/// Iterations and progress are sent at most this often; the last of a stage may be dropped, its end is not.
const PROGRESS_SECONDS: f64 = 0.03;

/// Sends events and snapshots to the host and awaits its promises.
pub(crate) struct TabObserver {
    pub(crate) wishes: Wishes,
    host: Host,
    component: usize,
    stage: Stage,
    finished: Arrays,
    last_snapshot: f64,
    last_breath: f64,
    last_progress: f64,
    deafness: Deafness,
}

/// Seconds since the worker started.
pub(crate) fn now() -> f64 {
    let clock = js_sys::Reflect::get(&js_sys::global(), &"performance".into()).unwrap_or(JsValue::UNDEFINED);
    clock.dyn_into::<web_sys::Performance>().map_or(0.0, |clock| clock.now() / 1000.0)
}

impl TabObserver {
    pub(crate) fn new(wishes: Wishes, deafness: Deafness, host: Host) -> Self {
        deafness.begin();
        Self {
            wishes,
            host,
            component: 0,
            finished: Arrays::default(),
            last_snapshot: f64::NEG_INFINITY,
            last_breath: now(),
            last_progress: f64::NEG_INFINITY,
            deafness,
            stage: Stage::Calibrate,
        }
    }

    /// A page that does not listen any more must not end the run.
    fn send(&self, kind: &str, value: &JsValue) {
        let _ = self.host.send(kind, value);
    }
}

impl Observer for TabObserver {
    fn event(&mut self, event: &Event) {
        if let Event::StageStarted { component, stage } = event {
            (self.component, self.stage) = (*component, *stage);
        }
        if matches!(event, Event::Progress { .. }) {
            let now = now();
            if now - self.last_progress < PROGRESS_SECONDS {
                return;
            }
            self.last_progress = now;
        }
        if let Ok(value) = to_js(event) {
            self.send("event", &value);
        }
    }

    fn should_stop(&self) -> bool {
        self.wishes.get() != Wish::GoOn
    }

    /// Within 200 ms (issue 5), also where a step of the solve takes seconds.
    fn interrupts(&self) -> bool {
        true
    }

    fn heard(&mut self) {
        self.deafness.resume();
    }

    fn now_seconds(&self) -> f64 {
        now()
    }

    fn snapshot(&mut self, component: &Component, complete: bool) {
        let now = now();
        if !complete && now - self.last_snapshot < SNAPSHOT_SECONDS {
            return;
        }
        self.last_snapshot = now;
        let mut arrays = self.finished.clone();
        arrays.push(self.component, &component.reconstruction, |k| component.graph_image[k]);
        if let Ok(value) = arrays.to_js(false) {
            self.send("snapshot", &value);
        }
        if complete {
            self.finished = arrays;
        }
    }

    fn wants_preview(&self) -> bool {
        now() - self.last_snapshot >= SNAPSHOT_SECONDS
    }

    fn preview(&mut self, component: &Component, places: &Places) {
        self.last_snapshot = now();
        let mut arrays = self.finished.clone();
        arrays.push_preview(self.component, &component.reconstruction, |k| component.graph_image[k], places);
        if let Ok(value) = arrays.to_js(false) {
            self.send("snapshot", &value);
        }
    }

    fn breathe(&mut self) -> Option<Breath> {
        self.deafness.listen(self.stage);
        let now = now();
        if now - self.last_breath < BREATH_SECONDS {
            return None;
        }
        self.last_breath = now;
        let promise = self.host.breathe().ok()?;
        let deafness = self.deafness.clone();
        Some(Box::pin(async move {
            let _ = JsFuture::from(promise).await;
            deafness.resume();
        }))
    }
}
