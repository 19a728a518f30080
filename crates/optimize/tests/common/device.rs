//! A WebGPU device for tests, and how they solve bundle adjustment on it.

use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{self, Options, Problem};
use epipole_optimize::gpu::{Device, GpuError, Limits};
use epipole_optimize::lm::{LmOptions, LmReport};
use pollster::block_on;

/// A device under WebGPU's default limits, or `None` with a loud line.
pub fn device() -> Option<Device> {
    match block_on(Device::open(Limits::Default)) {
        Ok(device) => {
            println!("on {}", device.description());
            Some(device)
        }
        Err(error @ GpuError::NoAdapter { .. }) => {
            println!("SKIPPED, nothing was tested: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// As far as single precision goes.
pub fn tight(activation: Activation) -> Options {
    let lm = LmOptions { max_iterations: 60, relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
    Options { lm, activation, ..Options::default() }
}

/// A whole solve, with a line on how it went.
pub fn on_gpu(device: &Device, problem: &mut Problem, options: &Options) -> LmReport {
    let report = block_on(bundle::gpu::solve(device, problem, options, &mut ())).expect("a good problem");
    println!(
        "{:.7e}, {} iterations, {} rejected, {} products, {:?}",
        report.final_cost, report.iterations, report.rejected, report.inner_iterations, report.termination
    );
    report
}
