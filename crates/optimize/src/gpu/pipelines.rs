//! Kernels made ready for a device, bound to buffers and dispatched.

use std::sync::{Arc, Mutex, PoisonError};

use super::compose::{compose, variants};
use super::device::Device;
use super::error::GpuError;
use super::kernels::{Access, Kernel};
use super::timer::{Stamp, Timer};
use super::turns::Halt;
use super::variant::Variant;
use crate::lm::{Observer, breath};

/// WebGPU's default limit of workgroups along one dimension.
const MAX_GROUPS: u64 = 65_535;

/// Workgroups along x and y that hold at least `groups`. Kernels compute the linear index and skip what is beyond.
pub fn split_groups(groups: u64) -> Result<[u32; 2], GpuError> {
    let y = groups.div_ceil(MAX_GROUPS).max(1);
    if y > MAX_GROUPS {
        return Err(GpuError::DispatchTooLarge { groups });
    }
    // Even rows waste fewer groups than full ones with a short last.
    Ok([groups.div_ceil(y) as u32, y as u32])
}

/// Compiled kernels of one variant.
#[derive(Debug)]
pub struct Pipelines {
    compiled: Vec<Compiled>,
}

/// A kernel ready to be bound.
#[derive(Clone, Debug)]
struct Compiled {
    kernel: Kernel,
    /// Only the flags that the shader asks for, so that variants share what is the same.
    variant: Variant,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

/// What a device has compiled so far: a mapper solves hundreds of problems, and each would wait for the compiler.
#[derive(Debug, Default)]
pub(super) struct Cache(Mutex<Vec<Compiled>>);

/// A kernel with its buffers, ready to be dispatched.
#[derive(Clone, Debug)]
pub struct Bound {
    kernel: &'static str,
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    timer: Arc<Timer>,
}

impl Pipelines {
    /// Compiles kernels without any flag, where the device has not yet. A shader that the device refuses is reported
    /// here, with what the compiler said.
    pub fn new(device: &Device, kernels: &[Kernel]) -> Result<Self, GpuError> {
        Self::for_variant(device, kernels, Variant::default())
    }

    /// As [`Pipelines::new`], with a problem's flags; shaders ignore those that they do not ask for.
    pub fn for_variant(device: &Device, kernels: &[Kernel], variant: Variant) -> Result<Self, GpuError> {
        device.check()?;
        let mut cached = device.pipelines.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut compiled = Vec::with_capacity(kernels.len());
        for kernel in kernels {
            let asked = variants(kernel.file)?.last().map_or(variant, |all| variant.common(*all));
            let found = cached.iter().find(|c| c.kernel == *kernel && c.variant == asked);
            match found {
                Some(found) => compiled.push(found.clone()),
                None => {
                    let new = Compiled::new(device, kernel, asked)?;
                    cached.push(new.clone());
                    compiled.push(new);
                }
            }
        }
        Ok(Self { compiled })
    }

    /// Compiles ahead of [`Self::for_variant`], a kernel at a time with a breath after each: in a browser all of them take a
    /// second or, on a software adapter, ten, and nothing else is done meanwhile. Does nothing where nobody interrupts.
    pub(crate) async fn prepare(
        device: &Device,
        kernels: &[Kernel],
        variant: Variant,
        observer: &mut dyn Observer,
    ) -> Result<(), Halt> {
        let compiled = || device.pipelines.0.lock().unwrap_or_else(PoisonError::into_inner).len();
        for kernel in kernels {
            if !observer.interrupts() {
                return Ok(());
            }
            let before = compiled();
            Self::for_variant(device, std::slice::from_ref(kernel), variant)?;
            if compiled() == before {
                continue;
            }
            device.settle(observer).await?;
            breath(observer).await;
            if observer.should_stop() {
                return Err(Halt::Stopped);
            }
        }
        Ok(())
    }

    /// Binds whole buffers in the order of the kernel's table row. The kernel must be among those that were compiled.
    pub fn bind(&self, device: &Device, kernel: &Kernel, buffers: &[&wgpu::Buffer]) -> Result<Bound, GpuError> {
        let whole: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_buffer_binding()).collect();
        self.bind_parts(device, kernel, &whole)
    }

    /// The same with parts of buffers, whose offsets are multiples of 256 bytes.
    pub fn bind_parts(
        &self,
        device: &Device,
        kernel: &Kernel,
        buffers: &[wgpu::BufferBinding<'_>],
    ) -> Result<Bound, GpuError> {
        let refuse = |reason: String| GpuError::Refused { reason };
        let found = self.compiled.iter().find(|c| c.kernel.name == kernel.name);
        let Compiled { pipeline, layout, .. } =
            found.ok_or_else(|| refuse(format!("kernel `{}` was not compiled", kernel.name)))?;
        if buffers.len() != kernel.bindings.len() {
            return Err(refuse(format!("kernel `{}` got {} buffers", kernel.name, buffers.len())));
        }
        let entries: Vec<_> = buffers
            .iter()
            .zip(0..)
            .map(|(part, binding)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::Buffer(part.clone()),
            })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor { label: Some(kernel.name), layout, entries: &entries };
        let group = device.device.create_bind_group(&descriptor);
        let timer = device.timer.clone();
        device.check().map(|()| Bound { kernel: kernel.name, pipeline: pipeline.clone(), group, timer })
    }
}

impl Compiled {
    fn new(device: &Device, kernel: &Kernel, variant: Variant) -> Result<Self, GpuError> {
        let source = wgpu::ShaderSource::Wgsl(compose(kernel.file, variant)?.into());
        let name = Some(kernel.name);
        let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: name, source });
        let entries: Vec<_> = kernel.bindings.iter().zip(0..).map(|(b, slot)| entry(slot, b.access)).collect();
        let layout =
            device.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: name, entries: &entries });
        let pipeline_layout = device.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: name,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: name,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: name,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        device.check().map(|()| Self { kernel: *kernel, variant, pipeline, layout })
    }
}

impl Bound {
    /// Records a dispatch of `groups` workgroups in a pass of its own: the next one sees what it wrote.
    pub fn dispatch(&self, encoder: &mut wgpu::CommandEncoder, groups: u64) -> Result<(), GpuError> {
        if groups == 0 {
            return Ok(());
        }
        let [x, y] = split_groups(groups)?;
        let stamp = self.timer.stamp(self.kernel);
        let timestamp_writes = stamp.as_ref().map(Stamp::writes);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        Ok(())
    }
}

fn entry(binding: u32, access: Access) -> wgpu::BindGroupLayoutEntry {
    let ty = match access {
        Access::Uniform => wgpu::BufferBindingType::Uniform,
        Access::Read => wgpu::BufferBindingType::Storage { read_only: true },
        Access::Write => wgpu::BufferBindingType::Storage { read_only: false },
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}
