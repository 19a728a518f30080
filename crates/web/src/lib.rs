//! The engine in a browser tab: what the page's worker calls, and nothing else. The same mapper as the command line.
//!
//! Everything here runs in one dedicated worker, but for pairs that it hands to helpers. Nothing blocks for long: the pipeline breathes between iterations, so
//! that messages get in and a person can stop it.
#![cfg(target_family = "wasm")]

mod answers;
mod backend;
mod bytes;
mod color;
mod control;
mod deafness;
mod depths;
mod error;
mod export;
mod helpers;
mod host;
mod memory;
mod model;
mod observer;
mod opened;
mod panic;
mod pictures;
mod query;
mod run;
mod session;
mod snapshot;
mod solve;
mod source;

pub use control::Control;
pub use helpers::solve_pairs;
pub use session::Session;
