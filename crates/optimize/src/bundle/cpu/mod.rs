//! Bundle adjustment on the CPU. A WebGPU system will stand beside this folder and keep its division of work.

mod back_substitution;
mod camera_step;
mod coarse;
mod depth_limits;
mod elimination;
mod implicit;
mod linearization;
mod normal;
mod point_block;
mod points_only;
mod projection;
mod reduced_solver;
mod revive;
mod rows;
mod small;
mod state;
mod structure;
mod system;
#[cfg(test)]
mod tests;
mod trial;

/// Rows of an observation without depth: the pixel.
pub(super) const PIXELS: usize = 2;
/// Rows of an observation where any has a depth: the pixel and the inverse depth, zero where it is unknown.
pub(super) const WITH_DEPTH: usize = 3;

pub(super) use points_only::solve_points;
pub use system::CpuSystem;
