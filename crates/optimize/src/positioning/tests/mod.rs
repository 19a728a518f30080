//! Tests of positioning on scenes with known truth.

mod accuracy;
mod input;
mod linear;
pub(crate) mod metric;
mod robust;
pub(crate) mod scene;
