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
mod small;
mod state;
mod structure;
mod system;
#[cfg(test)]
mod tests;
mod trial;

pub(super) use points_only::solve_points;
pub use system::CpuSystem;
