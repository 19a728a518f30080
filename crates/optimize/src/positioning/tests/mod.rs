//! Tests of positioning on scenes with known truth.

mod accuracy;
mod input;
mod linear;
mod metric;
mod robust;
mod scene;
