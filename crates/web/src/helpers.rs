//! Workers beside the engine's own, for the pairs of a scene: both ends of them.

use epipole_mapper::Stage;
use epipole_mapper::stages::relative_pose::{self, Answering, PairPool};
use js_sys::Float64Array;
use wasm_bindgen::JsCast;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};
use wasm_bindgen_futures::JsFuture;

use crate::deafness::Deafness;
use crate::host::Host;

/// What a helper does: solves a batch of pairs. Nothing where it is no batch of this build.
#[wasm_bindgen(js_name = solvePairs)]
pub fn solve_pairs(problems: &[f64]) -> Option<Vec<f64>> {
    relative_pose::solve_pairs(problems)
}

/// The helpers that the worker may start.
pub(crate) struct TabPool {
    pub(crate) host: Host,
    pub(crate) deafness: Deafness,
}

impl PairPool for TabPool {
    fn start(&mut self) -> Result<usize, String> {
        self.host.start_helpers(&wasm_bindgen::module()).map(|count| count as usize).map_err(text)
    }

    fn solve(&mut self, problems: &[f64]) -> Answering {
        self.deafness.listen(Stage::RelativePose);
        // Listened to from here on, not from the first poll: a promise that nobody listens to complains when it is broken.
        let (promise, deafness) = (self.host.solve_pairs(problems).map(JsFuture::from), self.deafness.clone());
        Box::pin(async move {
            let answer = promise.map_err(text)?.await;
            // While it waited, this worker heard everything.
            deafness.resume();
            answer.map(|numbers| numbers.unchecked_into::<Float64Array>().to_vec()).map_err(text)
        })
    }

    fn end(&mut self) {
        // Nobody is left to tell of a failure: what was answered holds.
        let _ = self.host.end_helpers();
    }
}

fn text(error: JsValue) -> String {
    error.as_string().unwrap_or_else(|| format!("{error:?}"))
}
