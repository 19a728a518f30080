//! Buffers: made within the device's limits, filled from and read back to plain slices.

use std::future::poll_fn;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Poll, Waker};

use bytemuck::Pod;

use super::device::Device;
use super::error::GpuError;

/// WebGPU does not bind empty buffers; a vec4 also satisfies every element type in the kernels.
const MIN_BYTES: u64 = 16;

/// A staging buffer that is used again and again: the only way in which data leaves the device.
#[derive(Debug)]
pub struct ReadBack {
    staging: wgpu::Buffer,
}

/// An answer on its way.
#[derive(Clone, Debug, Default)]
pub struct Pending(Arc<Mutex<Answer>>);

/// What `map_async` answered, and who waits for it.
#[derive(Debug, Default)]
struct Answer {
    result: Option<Result<(), wgpu::BufferAsyncError>>,
    waker: Option<Waker>,
}

impl Device {
    /// A storage buffer that holds `data`.
    pub fn storage<T: Pod>(&self, name: &'static str, data: &[T]) -> Result<wgpu::Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.zeroed(name, bytes.len() as u64)?;
        self.write(&buffer, data);
        Ok(buffer)
    }

    /// A storage buffer of zeros.
    pub fn zeroed(&self, name: &'static str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        self.buffer(name, bytes, usage)
    }

    /// A uniform buffer that holds `value`, whose size must be a multiple of 16 bytes.
    pub fn uniform<T: Pod>(&self, name: &'static str, value: &T) -> Result<wgpu::Buffer, GpuError> {
        let buffer = self.uniforms(name, size_of::<T>() as u64)?;
        self.write(&buffer, std::slice::from_ref(value));
        Ok(buffer)
    }

    /// A uniform buffer of `bytes`, to be written later.
    pub fn uniforms(&self, name: &'static str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        self.buffer(name, bytes, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)
    }

    /// Overwrites the start of a buffer, in queue order.
    pub fn write<T: Pod>(&self, buffer: &wgpu::Buffer, data: &[T]) {
        if !data.is_empty() {
            self.queue.write_buffer(buffer, 0, bytemuck::cast_slice(data));
        }
    }

    /// A read-back of up to `bytes`.
    pub fn read_back(&self, name: &'static str, bytes: u64) -> Result<ReadBack, GpuError> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        Ok(ReadBack { staging: self.buffer(name, bytes, usage)? })
    }

    /// A whole buffer, for tests and for the final state; inside a solve a [`ReadBack`] is kept instead.
    pub async fn download<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        let bytes = (count * size_of::<T>()) as u64;
        let read_back = self.read_back("download", bytes)?;
        let mut encoder = self.encoder();
        read_back.copy(&mut encoder, buffer, 0, 0, bytes);
        self.submit(encoder);
        read_back.get(self, count).await
    }

    /// A command encoder.
    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Queues the commands.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) {
        self.queue.submit([encoder.finish()]);
    }

    fn buffer(&self, name: &'static str, bytes: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
        self.check()?;
        let allowed = if usage.contains(wgpu::BufferUsages::STORAGE) {
            self.max_binding_bytes()
        } else {
            self.device.limits().max_buffer_size
        };
        if bytes > allowed {
            return Err(GpuError::BufferTooLarge { buffer: name, needed_bytes: bytes, allowed_bytes: allowed });
        }
        let size = bytes.max(MIN_BYTES).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        let descriptor = wgpu::BufferDescriptor { label: Some(name), size, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        self.check().map(|()| buffer)
    }
}

impl ReadBack {
    /// Records a copy from a buffer into this read-back, offsets in bytes.
    pub fn copy(&self, encoder: &mut wgpu::CommandEncoder, from: &wgpu::Buffer, offset: u64, to: u64, bytes: u64) {
        if bytes > 0 {
            encoder.copy_buffer_to_buffer(from, offset, &self.staging, to, bytes);
        }
    }

    /// Waits for the commands submitted so far and returns the first `count` values.
    pub async fn get<T: Pod>(&self, device: &Device, count: usize) -> Result<Vec<T>, GpuError> {
        let pending = self.begin();
        device.wait()?;
        let mapped = poll_fn(|context| {
            let mut answer = pending.0.lock().unwrap_or_else(PoisonError::into_inner);
            match answer.result.take() {
                Some(result) => Poll::Ready(result),
                None => {
                    answer.waker = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        });
        let mapped = mapped.await;
        device.check()?;
        mapped.map_err(lost)?;
        let values = self.values(0, count);
        self.staging.unmap();
        values
    }

    /// Asks for what the commands submitted so far have copied here, without waiting for it.
    pub fn begin(&self) -> Pending {
        let pending = Pending::default();
        let setter = pending.0.clone();
        self.staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let mut answer = setter.lock().unwrap_or_else(PoisonError::into_inner);
            answer.result = Some(result);
            if let Some(waker) = answer.waker.take() {
                waker.wake();
            }
        });
        pending
    }

    /// Hands what has arrived to `read`, which takes [`Self::values`] out of it, and makes the read-back ready for the
    /// next copy.
    pub fn finish<T>(&self, pending: &Pending, read: impl FnOnce(&Self) -> Result<T, GpuError>) -> Result<T, GpuError> {
        let mut answer = pending.0.lock().unwrap_or_else(PoisonError::into_inner);
        let early = || GpuError::Refused { reason: "a read-back was finished before it arrived".into() };
        answer.result.take().ok_or_else(early)?.map_err(lost)?;
        let found = read(self);
        self.staging.unmap();
        found
    }

    /// `count` values from an offset in bytes, while they are mapped.
    pub fn values<T: Pod>(&self, offset: u64, count: usize) -> Result<Vec<T>, GpuError> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let end = offset + (count * size_of::<T>()) as u64;
        let range = self.staging.get_mapped_range(offset..end);
        let view = range.map_err(|error| GpuError::Refused { reason: error.to_string() })?;
        Ok(bytemuck::pod_collect_to_vec(&view[..]))
    }
}

impl Pending {
    /// Whether the answer is there: values, or that there are none to come.
    pub fn has_arrived(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).result.is_some()
    }
}

/// wgpu knows no more than that; a browser says why it took a device away only after this.
fn lost(_: wgpu::BufferAsyncError) -> GpuError {
    GpuError::Lost { reason: "it no longer answers".into() }
}
