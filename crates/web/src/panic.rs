//! A panic is a mistake of ours: its text must reach the page before the module stops.

use wasm_bindgen::prelude::wasm_bindgen;

#[wasm_bindgen]
extern "C" {
    /// Given by the worker.
    #[wasm_bindgen(js_namespace = globalThis, js_name = epipolePanicked)]
    fn panicked(message: &str);
}

/// Sends the text of panics to the worker.
#[wasm_bindgen(start)]
fn install() {
    std::panic::set_hook(Box::new(|info| panicked(&info.to_string())));
}
