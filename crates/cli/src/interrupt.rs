//! Ctrl-C: the first one asks the work to stop and keep what is finished, the second one ends the program.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

static STOP: AtomicBool = AtomicBool::new(false);
static INSTALLED: OnceLock<()> = OnceLock::new();

/// The exit code of a program that Ctrl-C ended, by the convention of shells (128 + SIGINT).
const KILLED: i32 = 130;

/// Starts listening.
pub(crate) fn install() {
    INSTALLED.get_or_init(|| {
        let handler = || {
            if STOP.swap(true, Ordering::SeqCst) {
                std::process::exit(KILLED);
            }
            eprintln!(
                "\nepipole: stopping at the next safe point and keeping what is finished (Ctrl-C again: at once)"
            );
        };
        // Without a handler Ctrl-C ends the program as it would any other; nothing half-written stays in either case.
        let _ = ctrlc::set_handler(handler);
    });
}

/// Whether somebody asked to stop.
pub(crate) fn requested() -> bool {
    STOP.load(Ordering::SeqCst)
}
