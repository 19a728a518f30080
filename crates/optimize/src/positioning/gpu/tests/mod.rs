//! Tests of positioning on a device (lavapipe where there is no GPU).

mod solves;
mod table;

use pollster::block_on;

use crate::error::OptimizeError;
use crate::gpu::Device;
use crate::positioning::{Options, Problem, Report};

/// Solves in chunks of the usual size.
fn on_gpu(device: &Device, problem: &mut Problem, options: &Options) -> Result<Report, OptimizeError> {
    block_on(super::solve(device, problem, options, &mut ()))
}
