//! An adapter and its device: what it is called, what it allows, and whether it still lives.

use std::sync::{Arc, Mutex, PoisonError};

use super::error::GpuError;
use super::pipelines::Cache;
use super::timer::Timer;

/// Which limits to ask an adapter for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Limits {
    /// WebGPU's defaults, with buffers as large as the adapter allows. Nothing needs the larger buffers.
    #[default]
    Adapter,
    /// WebGPU's defaults exactly: what every browser gives.
    Default,
}

/// A device with its queue. Cheap to share by reference; lost or not, it answers with errors, never with panics.
#[derive(Debug)]
pub struct Device {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    description: String,
    software: bool,
    fault: Fault,
    pub(super) pipelines: Cache,
    pub(super) timer: Arc<Timer>,
}

/// The first failure that the device reported, from whichever thread.
#[derive(Clone, Debug, Default)]
struct Fault(Arc<Mutex<Option<GpuError>>>);

impl Fault {
    fn set(&self, error: GpuError) {
        let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // A lost device explains every other failure; else the first failure explains the later ones.
        if slot.is_none() || matches!(error, GpuError::Lost { .. }) {
            *slot = Some(error);
        }
    }

    fn get(&self) -> Option<GpuError> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Device {
    /// Opens the fastest adapter, a software one where there is no other.
    pub async fn open(limits: Limits) -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let request = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = instance
            .request_adapter(&request)
            .await
            .map_err(|error| GpuError::NoAdapter { reason: error.to_string() })?;
        let info = adapter.get_info();
        let mut required_limits = wgpu::Limits::default();
        if limits == Limits::Adapter {
            let offered = adapter.limits();
            required_limits.max_buffer_size = offered.max_buffer_size.max(required_limits.max_buffer_size);
            required_limits.max_storage_buffer_binding_size =
                offered.max_storage_buffer_binding_size.max(required_limits.max_storage_buffer_binding_size);
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("epipole"),
            // Only benchmarks use them; a device without is as good.
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = adapter
            .request_device(&descriptor)
            .await
            .map_err(|error| GpuError::NoDevice { adapter: info.name.clone(), reason: error.to_string() })?;
        let fault = Fault::default();
        let on_lost = fault.clone();
        device.set_device_lost_callback(move |reason, message| {
            on_lost.set(GpuError::Lost { reason: format!("{reason:?}: {message}") });
        });
        let on_error = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let reason = error.to_string();
            on_error.set(match error {
                wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory { reason },
                _ => GpuError::Refused { reason },
            });
        }));
        let software = info.device_type == wgpu::DeviceType::Cpu;
        let kind = if software { "software adapter, correct but slow" } else { "hardware adapter" };
        // Browsers hide what they call an adapter.
        let name = if info.name.is_empty() { "unnamed GPU" } else { &info.name };
        let description = format!("{name} ({:?}, {kind})", info.backend);
        Ok(Self { device, queue, description, software, fault, pipelines: Cache::default(), timer: Arc::default() })
    }

    /// Name, API and kind of the adapter, for people.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Whether the adapter is a program on the CPU (lavapipe, SwiftShader, WARP).
    pub fn is_software(&self) -> bool {
        self.software
    }

    /// Largest storage buffer that a kernel can bind.
    pub fn max_binding_bytes(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// The first failure since the device was opened, if any.
    pub fn check(&self) -> Result<(), GpuError> {
        self.fault.get().map_or(Ok(()), Err)
    }

    /// Gives the device up: everything queued or asked for later fails with [`GpuError::Lost`].
    pub fn destroy(&self) {
        self.device.destroy();
        self.fault.set(GpuError::Lost { reason: "destroyed by its owner".into() });
    }

    /// Lets the driver run callbacks; blocks until the queue is empty where that is possible (not in a browser, whose
    /// event loop runs them).
    pub(super) fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|error| GpuError::Lost { reason: error.to_string() })
    }
}
