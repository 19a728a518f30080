//! Kernels made ready for a device, bound to buffers and dispatched.

use super::compose::compose;
use super::device::Device;
use super::error::GpuError;
use super::kernels::{Access, Kernel};

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

/// Compiled kernels.
#[derive(Debug)]
pub struct Pipelines {
    compiled: Vec<(Kernel, wgpu::ComputePipeline, wgpu::BindGroupLayout)>,
}

/// A kernel with its buffers, ready to be dispatched.
#[derive(Clone, Debug)]
pub struct Bound {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

impl Pipelines {
    /// Compiles kernels. A shader that the device refuses is reported here, with what the compiler said.
    pub fn new(device: &Device, kernels: &[Kernel]) -> Result<Self, GpuError> {
        let mut compiled = Vec::with_capacity(kernels.len());
        for kernel in kernels {
            let source = wgpu::ShaderSource::Wgsl(compose(kernel.file)?.into());
            let name = Some(kernel.name);
            let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: name, source });
            let entries: Vec<_> = kernel.bindings.iter().zip(0..).map(|(b, slot)| entry(slot, b.access)).collect();
            let layout = device
                .device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: name, entries: &entries });
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
            device.check()?;
            compiled.push((*kernel, pipeline, layout));
        }
        Ok(Self { compiled })
    }

    /// Binds buffers in the order of the kernel's table row. The kernel must be among those that were compiled.
    pub fn bind(&self, device: &Device, kernel: &Kernel, buffers: &[&wgpu::Buffer]) -> Result<Bound, GpuError> {
        let refuse = |reason: String| GpuError::Refused { reason };
        let found = self.compiled.iter().find(|(k, _, _)| k.name == kernel.name);
        let (_, pipeline, layout) =
            found.ok_or_else(|| refuse(format!("kernel `{}` was not compiled", kernel.name)))?;
        if buffers.len() != kernel.bindings.len() {
            return Err(refuse(format!("kernel `{}` got {} buffers", kernel.name, buffers.len())));
        }
        let entries: Vec<_> = buffers
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor { label: Some(kernel.name), layout, entries: &entries };
        let group = device.device.create_bind_group(&descriptor);
        device.check().map(|()| Bound { pipeline: pipeline.clone(), group })
    }
}

impl Bound {
    /// Records a dispatch of `groups` workgroups in a pass of its own: the next one sees what it wrote.
    pub fn dispatch(&self, encoder: &mut wgpu::CommandEncoder, groups: u64) -> Result<(), GpuError> {
        if groups == 0 {
            return Ok(());
        }
        let [x, y] = split_groups(groups)?;
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
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
