//! Tests of the room: shaders against the table, and a device under WebGPU's default limits.

mod device;
mod shaders;

use pollster::block_on;

use super::{Device, GpuError, Limits};

/// A device with default limits, or `None` with a loud line where the machine has no adapter.
pub(crate) fn device() -> Option<Device> {
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
