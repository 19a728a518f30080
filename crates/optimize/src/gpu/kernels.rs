//! The one table of kernels: whatever runs on a device is listed here, and a test holds the shaders to it.

mod bundle;
pub mod positioning;

pub use bundle::*;
use positioning::POSITIONING;

/// How a kernel uses a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Uniform buffer.
    Uniform,
    /// Storage buffer, read only.
    Read,
    /// Storage buffer, read and written.
    Write,
}

/// A buffer of a kernel. Its place in [`Kernel::bindings`] is its `@binding`, always in group 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Name of the variable in the shader.
    pub name: &'static str,
    /// How it is used.
    pub access: Access,
}

/// A kernel. Its entry point is called as the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kernel {
    /// Name of kernel and entry point.
    pub name: &'static str,
    /// File below `shaders/`; its conditions say in which [variants](super::Variant) the kernel exists.
    pub file: &'static str,
    /// Invocations of a workgroup, along x.
    pub workgroup_size: u32,
    /// Buffers.
    pub bindings: &'static [Binding],
}

const fn uniform(name: &'static str) -> Binding {
    Binding { name, access: Access::Uniform }
}

const fn read(name: &'static str) -> Binding {
    Binding { name, access: Access::Read }
}

const fn write(name: &'static str) -> Binding {
    Binding { name, access: Access::Write }
}

/// Writes each workgroup's linear index: shows that dispatches beyond one dimension reach every group once.
pub const PROBE: Kernel = Kernel {
    name: "probe",
    file: "common/probe.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("probe_params"), write("groups")],
};

/// Evaluates camera models ray by ray: shows that they are those of the CPU.
pub const CAMERA_PROBE: Kernel = Kernel {
    name: "camera_probe",
    file: "common/camera_probe.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("camera_probe_params"), read("intrinsics"), read("rays"), write("rows")],
};

/// Sums rows of eight values (the eighth: maximum) by spans, one span a workgroup.
pub const REDUCE: Kernel = Kernel {
    name: "reduce",
    file: "common/reduce.wgsl",
    workgroup_size: 64,
    bindings: &[uniform("reduce_params"), read("rows"), write("sums")],
};

/// Reads a buffer once: what the device's memory can do, for the benchmark.
pub const STREAM_READ: Kernel = Kernel {
    name: "stream_read",
    file: "bench/stream_read.wgsl",
    workgroup_size: 256,
    bindings: &[uniform("stream_params"), read("stream"), write("sums")],
};

/// The device room's own; [`REDUCE`] is listed with bundle adjustment's.
const OWN: &[Kernel] = &[PROBE, STREAM_READ, CAMERA_PROBE];

/// Every kernel: the device room's own, then those of the problems.
pub const KERNELS: &[Kernel] = &{
    let all = [PROBE; OWN.len() + BUNDLE.len() + POSITIONING.len()];
    let all = placed(placed(all, 0, OWN), OWN.len(), BUNDLE);
    placed(all, OWN.len() + BUNDLE.len(), POSITIONING)
};

const fn placed<const N: usize>(mut all: [Kernel; N], first: usize, kernels: &[Kernel]) -> [Kernel; N] {
    let mut i = 0;
    while i < kernels.len() {
        all[first + i] = kernels[i];
        i += 1;
    }
    all
}
