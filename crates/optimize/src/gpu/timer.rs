//! How long kernels take by the device's own clock, where it has one (WebGPU's `timestamp-query`): for benchmarks.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use super::device::Device;
use super::error::GpuError;

/// Dispatches that a query set holds: WebGPU allows 4096 queries in one, and each takes two.
const PER_SET: usize = 2048;
/// Sets beyond this are not made; later dispatches go untimed. 200 000 dispatches are a long solve.
const MAX_SETS: usize = 100;

/// How long a kernel's dispatches took on the device, by its own clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelTime {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Dispatches that were timed.
    pub dispatches: u64,
    /// Their time in all, from the start of each pass to its end.
    pub seconds: f64,
}

/// Times while asked to.
#[derive(Debug, Default)]
pub(super) struct Timer(Mutex<Option<Timing>>);

#[derive(Debug)]
struct Timing {
    device: wgpu::Device,
    sets: Vec<wgpu::QuerySet>,
    /// Kernel of every timed dispatch, in order.
    kernels: Vec<&'static str>,
}

/// Where a dispatch's two timestamps go.
pub(super) struct Stamp {
    set: wgpu::QuerySet,
    first: u32,
}

impl Stamp {
    pub(super) fn writes(&self) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(self.first),
            end_of_pass_write_index: Some(self.first + 1),
        }
    }
}

impl Timer {
    /// Where a dispatch's times go, if it is to be timed.
    pub(super) fn stamp(&self, kernel: &'static str) -> Option<Stamp> {
        let mut timing = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let timing = timing.as_mut()?;
        let slot = timing.kernels.len();
        if slot / PER_SET == timing.sets.len() {
            if timing.sets.len() == MAX_SETS {
                return None;
            }
            timing.sets.push(timing.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PER_SET as u32,
            }));
        }
        timing.kernels.push(kernel);
        Some(Stamp { set: timing.sets[slot / PER_SET].clone(), first: 2 * (slot % PER_SET) as u32 })
    }
}

impl Device {
    /// Whether kernels can be timed (WebGPU's optional feature `timestamp-query`).
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Times every dispatch from now on, where the device can.
    pub fn start_timing(&self) {
        if self.has_timestamps() {
            let timing = Timing { device: self.device.clone(), sets: Vec::new(), kernels: Vec::new() };
            *self.timer.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(timing);
        }
    }

    /// Ends the timing and waits for it: kernels by name. Empty without [`Self::start_timing`] or timestamps.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails.
    pub async fn finish_timing(&self) -> Result<Vec<KernelTime>, GpuError> {
        let Some(timing) = self.timer.0.lock().unwrap_or_else(PoisonError::into_inner).take() else {
            return Ok(Vec::new());
        };
        let seconds_per_tick = f64::from(self.queue.get_timestamp_period()) * 1e-9;
        let mut times: BTreeMap<&'static str, KernelTime> = BTreeMap::new();
        for (set, kernels) in timing.sets.iter().zip(timing.kernels.chunks(PER_SET)) {
            let count = 2 * kernels.len();
            let ticks: Vec<u64> = self.resolve(set, count).await?;
            for (&kernel, pair) in kernels.iter().zip(ticks.chunks_exact(2)) {
                let time = times.entry(kernel).or_insert(KernelTime { kernel, dispatches: 0, seconds: 0.0 });
                time.dispatches += 1;
                // Clocks of some drivers run backwards over a reset of their counter.
                time.seconds += pair[1].saturating_sub(pair[0]) as f64 * seconds_per_tick;
            }
        }
        Ok(times.into_values().collect())
    }

    async fn resolve(&self, set: &wgpu::QuerySet, count: usize) -> Result<Vec<u64>, GpuError> {
        let bytes = (count * size_of::<u64>()) as u64;
        let resolved = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timestamps"),
            size: bytes,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = self.encoder();
        encoder.resolve_query_set(set, 0..count as u32, &resolved, 0);
        self.submit(encoder);
        self.download(&resolved, count).await
    }
}
