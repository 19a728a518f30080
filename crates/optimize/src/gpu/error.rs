//! Why a device cannot do what was asked, said with what to do about it.

/// What is wrong with a device or with a request to it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// No adapter at all.
    #[error(
        "no WebGPU adapter was found ({reason}); install a Vulkan driver (on Debian `mesa-vulkan-drivers`) or use the CPU"
    )]
    NoAdapter {
        /// What wgpu said.
        reason: String,
    },
    /// The adapter does not give a device, not even with WebGPU's default limits.
    #[error("adapter `{adapter}` gives no device with WebGPU's default limits ({reason}); use the CPU")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// What wgpu said.
        reason: String,
    },
    /// The device went away: driver reset, unplugged, destroyed.
    #[error("the GPU device was lost ({reason}); go on with a new device or on the CPU")]
    Lost {
        /// What wgpu said.
        reason: String,
    },
    /// A buffer is larger than the device allows.
    #[error(
        "buffer `{buffer}` needs {needed_bytes} bytes, the device allows {allowed_bytes}; use the CPU or split the problem"
    )]
    BufferTooLarge {
        /// What it is for.
        buffer: &'static str,
        /// Its size.
        needed_bytes: u64,
        /// The device's limit.
        allowed_bytes: u64,
    },
    /// More workgroups than two dimensions hold.
    #[error("{groups} workgroups are more than a dispatch holds; split the problem")]
    DispatchTooLarge {
        /// How many.
        groups: u64,
    },
    /// Device memory ran out.
    #[error("the GPU ran out of memory ({reason}); use the CPU or split the problem")]
    OutOfMemory {
        /// What wgpu said.
        reason: String,
    },
    /// wgpu refused a command or a shader: a bug of ours.
    #[error("the GPU refused a command, please report this: {reason}")]
    Refused {
        /// What wgpu said.
        reason: String,
    },
    /// A shader file that is imported but not listed.
    #[error("shader `{file}` is not in the list of sources; add it to `gpu/compose.rs`")]
    UnknownShader {
        /// Path below `shaders/`.
        file: String,
    },
    /// A condition in a shader asks for a flag that does not exist.
    #[error("shader `{file}`, line {line}: there is no flag `{flag}`; add it to `gpu/variant.rs` or mend the name")]
    UnknownFlag {
        /// Path below `shaders/`.
        file: String,
        /// Line, from 1.
        line: usize,
        /// The name asked for.
        flag: String,
    },
    /// `#if`, `#else` and `#endif` do not pair up.
    #[error("shader `{file}`, line {line}: `#if FLAG`, `#else` and `#endif` do not pair up")]
    UnbalancedCondition {
        /// Path below `shaders/`.
        file: String,
        /// Line, from 1, where it shows.
        line: usize,
    },
    /// The kernels do not cover this kind of problem.
    #[error("{what} is not available on the GPU yet; use the CPU")]
    Unsupported {
        /// What is asked for.
        what: &'static str,
    },
}
