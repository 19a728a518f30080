//! What every run in the tab begins with, and how one is given up.

use epipole_mapper::{Options, Settings};
use epipole_optimize::Engine;
use wasm_bindgen::JsValue;

use crate::backend::{self, Chosen};
use crate::control::Wish;
use crate::error::Failure;
use crate::host::Host;
use crate::observer::TabObserver;
use crate::session::{Answer, Session, to_js};

/// What a run works with.
pub(crate) struct Run {
    pub(crate) options: Options,
    pub(crate) engine: Engine,
    pub(crate) observer: TabObserver,
}

impl Session {
    /// Reads the settings, as a settings file has them, and opens `backend` (`auto`, `gpu` or `cpu`) for solves of at most
    /// so many observations.
    pub(crate) async fn begin(
        &self,
        settings: JsValue,
        backend: &str,
        observations: usize,
        host: &Host,
    ) -> Answer<Run> {
        let settings: serde_json::Map<String, serde_json::Value> = serde_wasm_bindgen::from_value(settings)
            .map_err(|e| Failure::new("settings", e, "write an object such as {\"preset\": \"fast\"}"))?;
        let options = Settings(settings).resolve().map_err(|e| Failure::new("settings", e, ""))?;
        self.wishes.set(Wish::GoOn);
        let observer = TabObserver::new(self.wishes.clone(), self.deafness.clone(), host.clone());
        let Chosen { engine, place } = backend::choose(backend, observations).await?;
        // A page that does not listen any more must not end the run.
        let _ = host.send("backend", &to_js(&place)?);
        Ok(Run { options, engine, observer })
    }

    /// What a run gives, unless a person gives it up.
    pub(crate) async fn unless_cancelled<T>(&self, run: impl Future<Output = T>) -> Result<T, Failure> {
        let outcome = self.wishes.unless_cancelled(run).await;
        outcome.ok_or_else(|| Failure::new(&self.name, "cancelled", ""))
    }
}
