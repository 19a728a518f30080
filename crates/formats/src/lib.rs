//! Files in and out: COLMAP databases and models, PLY, nerfstudio and BAL. The only crate that touches the file system.
//!
//! Every reader treats its input as untrusted: it returns a typed [`FormatError`] or a value with [`FormatWarning`]s,
//! never panics, and never allocates by a count that the bytes present do not cover. Every writer is atomic.

mod atomic;
pub mod bal;
pub mod colmap;
mod cursor;
pub mod database;
pub mod depth;
mod error;
pub mod nerfstudio;
mod number;
pub mod ply;

pub use atomic::atomic_write;
pub use colmap::{
    ModelFormat, find_model_format, model_files, read_model, read_model_files, remove_model, write_model_binary,
    write_model_text,
};
pub use database::{RangedBytes, ReadOptions, read_database, read_ranged_database, write_database};
pub use error::{FormatError, FormatWarning, Loaded, Location, Problem};
