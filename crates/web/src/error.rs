//! A refusal as the page shows it: the file, the cause, the next step.

use epipole_formats::FormatError;
use serde::Serialize;
use wasm_bindgen::JsValue;

/// `Failure` of `web/engine/protocol.js`.
#[derive(Debug, Serialize)]
pub(crate) struct Failure {
    file: String,
    message: String,
    hint: String,
}

impl Failure {
    pub(crate) fn new(file: &str, message: impl ToString, hint: impl ToString) -> Self {
        Self { file: file.to_owned(), message: message.to_string(), hint: hint.to_string() }
    }

    /// A reader's error. Its message names the file itself; the page shows that apart.
    pub(crate) fn format(file: &str, error: &FormatError) -> Self {
        let text = error.to_string();
        let text = text.strip_prefix(file).map_or(text.as_str(), |rest| rest.trim_start_matches([':', ',', ' ']));
        match text.split_once("; ") {
            Some((message, hint)) => Self::new(file, message, hint),
            None => Self::new(file, text, ""),
        }
    }
}

impl From<Failure> for JsValue {
    fn from(failure: Failure) -> Self {
        serde_wasm_bindgen::to_value(&failure).unwrap_or_else(|_| Self::from_str(&failure.message))
    }
}
