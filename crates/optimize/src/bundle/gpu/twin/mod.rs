//! The kernels once more in Rust, with the same sums in the same order, for tests: in `f32` as twins, and in `f64` with
//! the magnitude of what was summed, which is what errors are measured by.

pub(crate) mod bench;
mod bounded;
mod camera;
mod cameras;
mod check_increment;
mod check_linear;
mod check_step;
mod coarse;
mod compaction;
mod depth;
mod models;
pub(crate) mod num;
mod observation;
mod points;
mod revive;
mod sight;
mod state;
mod test;
mod trace;
mod truncated;
mod vectors;
