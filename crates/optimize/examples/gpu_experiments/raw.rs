//! The least of wgpu that a measurement needs: nothing of the product's, so that its figures are about the device.

use std::time::Instant;

use wgpu::util::{BufferInitDescriptor, DeviceExt};

pub(crate) struct Gpu {
    pub(crate) name: String,
    device: wgpu::Device,
    queue: wgpu::Queue,
}

/// Kernels of one module over the same buffers.
pub(crate) struct Module {
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
}

impl Gpu {
    pub(crate) fn open() -> Result<Self, String> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let request = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&request)).map_err(|e| e.to_string())?;
        let info = adapter.get_info();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()))
            .map_err(|e| e.to_string())?;
        Ok(Self { name: format!("{} ({:?}, {:?})", info.name, info.backend, info.device_type), device, queue })
    }

    pub(crate) fn buffer<T: bytemuck::Pod>(&self, data: &[T], uniform: bool) -> wgpu::Buffer {
        let usage = if uniform { wgpu::BufferUsages::UNIFORM } else { wgpu::BufferUsages::STORAGE };
        let usage = usage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        self.device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(data),
            usage,
        })
    }

    pub(crate) fn zeroed(&self, bytes: u64) -> wgpu::Buffer {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let descriptor = wgpu::BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false };
        self.device.create_buffer(&descriptor)
    }

    /// `access` by binding: uniform, read or write.
    pub(crate) fn module(&self, source: &str, access: &str) -> Module {
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let entry = |(binding, kind): (u32, char)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match kind {
                    'u' => wgpu::BufferBindingType::Uniform,
                    kind => wgpu::BufferBindingType::Storage { read_only: kind == 'r' },
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let entries: Vec<_> = (0..).zip(access.chars()).map(entry).collect();
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        let layout = self.device.create_bind_group_layout(&descriptor);
        let pipeline_layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        Module { module, layout, pipeline_layout }
    }

    pub(crate) fn pipeline(&self, module: &Module, name: &str) -> wgpu::ComputePipeline {
        self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&module.pipeline_layout),
            module: &module.module,
            entry_point: Some(name),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    }

    pub(crate) fn group(&self, module: &Module, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let mut entries = Vec::with_capacity(buffers.len());
        for (binding, buffer) in (0..).zip(buffers) {
            entries.push(wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() });
        }
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout: &module.layout, entries: &entries };
        self.device.create_bind_group(&descriptor)
    }

    /// Queues dispatches, each in a pass of its own, in one submission.
    pub(crate) fn submit(&self, dispatches: &[(&wgpu::ComputePipeline, &wgpu::BindGroup, u32)]) {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for (pipeline, group, groups) in dispatches {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, *group, &[]);
            let y = groups.div_ceil(65_535).max(1);
            pass.dispatch_workgroups(groups.div_ceil(y), y, 1);
        }
        self.queue.submit([encoder.finish()]);
    }

    pub(crate) fn wait(&self) {
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("a live device");
    }

    pub(crate) fn read(&self, buffer: &wgpu::Buffer, bytes: u64) -> Vec<f32> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let descriptor = wgpu::BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false };
        let staging = self.device.create_buffer(&descriptor);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
        self.queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |result| result.expect("a live device"));
        self.wait();
        let view = staging.get_mapped_range(..).expect("mapped");
        bytemuck::pod_collect_to_vec(&view[..])
    }

    /// Seconds of some runs after one to warm up.
    pub(crate) fn time(&self, runs: usize, mut work: impl FnMut()) -> Seconds {
        work();
        self.wait();
        let mut wall = f64::INFINITY;
        let before = processor_seconds();
        for _ in 0..runs {
            let start = Instant::now();
            work();
            self.wait();
            wall = wall.min(start.elapsed().as_secs_f64());
        }
        Seconds { wall, processor: (processor_seconds() - before) / runs as f64 }
    }
}

/// The smallest wall time, and the mean of this process' processor time: what a software adapter used, which the rest of
/// a busy machine disturbs less. 0 where unknown.
#[derive(Clone, Copy)]
pub(crate) struct Seconds {
    pub(crate) wall: f64,
    pub(crate) processor: f64,
}

fn processor_seconds() -> f64 {
    let Ok(stat) = std::fs::read_to_string("/proc/self/stat") else { return 0.0 };
    let fields: Vec<f64> = stat.split_whitespace().skip(13).take(2).filter_map(|f| f.parse().ok()).collect();
    // USER_HZ is 100 on every Linux this runs on.
    fields.iter().sum::<f64>() / 100.0
}
