//! What the worker gives to a run: where messages go, time to read them, the browser's decoder of photographs, helpers.

use js_sys::Promise;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};
use web_sys::File;

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** What a run needs of its worker. */
export interface Host {
    /** Takes an event, a snapshot or where the run computes. */
    send(kind: "event" | "snapshot" | "backend", value: any): void;
    /** Kept when messages have been read and the run may go on. */
    breathe(): Promise<void>;
    /** A photograph without rotation, no side longer than `maxSide`, RGBA by rows. */
    decode(file: File, maxSide: number): Promise<{ width: number, height: number, data: Uint8ClampedArray }>;
    /** Starts helpers that run this module; their number, 0 where they would be of no use. */
    startHelpers(module: WebAssembly.Module): number;
    /** What `solvePairs` gives in one of them; fails with a text. The array is the module's own and must be copied. */
    solvePairs(problems: Float64Array): Promise<Float64Array>;
    /** Ends them, whatever they do. */
    endHelpers(): void;
}
"#;

#[wasm_bindgen]
extern "C" {
    /// `Host` of the section above.
    #[wasm_bindgen(typescript_type = "Host")]
    #[derive(Clone)]
    pub type Host;

    #[wasm_bindgen(method, catch)]
    pub(crate) fn send(this: &Host, kind: &str, value: &JsValue) -> Result<(), JsValue>;

    #[wasm_bindgen(method, catch)]
    pub(crate) fn breathe(this: &Host) -> Result<Promise, JsValue>;

    #[wasm_bindgen(method, catch)]
    pub(crate) fn decode(this: &Host, file: &File, max_side: u32) -> Result<Promise, JsValue>;

    #[wasm_bindgen(method, catch, js_name = startHelpers)]
    pub(crate) fn start_helpers(this: &Host, module: &JsValue) -> Result<u32, JsValue>;

    #[wasm_bindgen(method, catch, js_name = solvePairs)]
    pub(crate) fn solve_pairs(this: &Host, problems: &[f64]) -> Result<Promise, JsValue>;

    #[wasm_bindgen(method, catch, js_name = endHelpers)]
    pub(crate) fn end_helpers(this: &Host) -> Result<(), JsValue>;
}
