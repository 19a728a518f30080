//! Standard output: JSON lines and warnings that survive a closed pipe.

use std::io::Write;

use epipole_formats::FormatWarning;
use serde::Serialize;

/// Prints a line; a reader that has gone away (`| head`) is no failure of ours.
pub(crate) fn line(text: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// Prints a value as one line of JSON.
pub(crate) fn json_line(value: &impl Serialize) {
    match serde_json::to_string(value) {
        Ok(text) => line(&text),
        Err(error) => eprintln!("epipole: an event could not be written as JSON: {error}"),
    }
}

/// Reports what a reader dropped: as events, or to standard error.
pub(crate) fn warnings(warnings: &[FormatWarning], json: bool) {
    for warning in warnings {
        if json {
            json_line(&serde_json::json!({ "event": "warning", "message": warning.to_string() }));
        } else {
            eprintln!("warning: {warning}");
        }
    }
}
