//! The device room: everything that any problem needs to run on WebGPU, and the only compute user of wgpu.
//!
//! Kernels are listed in one table ([`kernels::KERNELS`]) and live in `shaders/`, put together from `#import` lines
//! in the [`Variant`] that a problem needs. The room asks an adapter for its limits and never needs more than WebGPU's defaults. Every failure is a [`GpuError`],
//! also one that a driver reports late: it comes out of the next read-back.

mod buffers;
pub mod compose;
mod device;
mod error;
mod failure;
pub mod kernels;
mod pipelines;
#[cfg(any(test, target_family = "wasm"))]
mod strip;
pub(crate) mod sums;
#[cfg(test)]
pub(crate) mod tests;
mod timer;
mod turns;
mod variant;

pub use buffers::{Pending, ReadBack};
pub use device::{Device, Limits};
pub use error::GpuError;
pub(crate) use failure::{Failure, Guard};
pub use pipelines::{Bound, Pipelines, split_groups};
pub use timer::KernelTime;
pub(crate) use turns::{Halt, Turns};
pub use variant::Variant;
