//! A problem's buffers on a device, and the kernels bound to them.

use super::chunks::{Chunk, Chunks};
use super::records::{Params, Settings};
use crate::gpu::kernels::positioning::{self as kernels, POSITIONING};
use crate::gpu::kernels::{Kernel, REDUCE};
use crate::gpu::sums::{self, ROW_BYTES};
use crate::gpu::{Bound, Device, GpuError, Pipelines};

/// vec4f of state and of a camera, as in `vectors.wgsl`.
const STATE_VEC4: usize = 4;
const SECTIONS: usize = 9;

/// What one dispatch of a kernel covers.
#[derive(Clone, Copy)]
enum Reach {
    /// A chunk's points, observations, segments, samples.
    Points,
    Observations,
    Segments,
    Samples,
    /// All cameras, one each.
    Cameras,
    /// A single workgroup.
    One,
}

fn reach(kernel: &Kernel) -> Reach {
    let is = |other: Kernel| kernel.name == other.name;
    if is(kernels::SPREAD) {
        Reach::Observations
    } else if is(kernels::PRECONDITION) || is(kernels::PRODUCT_CAMERA) {
        Reach::Segments
    } else if is(kernels::SAMPLE) {
        Reach::Samples
    } else if is(kernels::FACTOR) || is(kernels::COMMIT_CAMERA) {
        Reach::Cameras
    } else if [kernels::PCG_START, kernels::PCG_STEP, kernels::STEP_CAMERA, kernels::GAUGE].into_iter().any(is) {
        Reach::One
    } else {
        Reach::Points
    }
}

/// Buffers of one chunk.
#[derive(Debug)]
pub(super) struct ChunkBuffers {
    params: wgpu::Buffer,
    pub(super) points: wgpu::Buffer,
    tracks: wgpu::Buffer,
    pub(super) by_point: wgpu::Buffer,
    pub(super) by_camera: wgpu::Buffer,
    pub(super) rays: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    segments: wgpu::Buffer,
    samples: wgpu::Buffer,
}

/// Buffers that all chunks share.
#[derive(Debug)]
pub(super) struct SharedBuffers {
    pub(super) settings: wgpu::Buffer,
    reduce_params: wgpu::Buffer,
    /// Accepted, then tried centres, with ω.
    pub(super) centers: wgpu::Buffer,
    topology: wgpu::Buffer,
    pub(super) vectors: wgpu::Buffer,
    pub(super) partials: wgpu::Buffer,
    pub(super) block_sums: wgpu::Buffer,
    pub(super) sums: wgpu::Buffer,
    pub(super) reduced: wgpu::Buffer,
    pub(super) lengths: wgpu::Buffer,
}

/// A kernel bound once for each chunk, or once for all.
#[derive(Debug)]
struct Ready {
    name: &'static str,
    dispatches: Vec<(Bound, u64)>,
}

/// A problem on a device.
#[derive(Debug)]
pub(super) struct Resident {
    pub(super) chunks: Vec<ChunkBuffers>,
    pub(super) shared: SharedBuffers,
    /// Rows that the host adds.
    pub(super) rows: usize,
    ready: Vec<Ready>,
}

impl Resident {
    pub(super) fn new(
        device: &Device,
        cameras: usize,
        rays: &[[f32; 4]],
        arrangement: &Chunks,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let (span, rows) = sums::spans(arrangement.groups as u64);
        let rows = rows as usize;
        let zeroed = |name, bytes: usize| device.zeroed(name, bytes as u64);
        let shared = SharedBuffers {
            settings: device.uniform("settings", &settings.words())?,
            reduce_params: device.uniform("reduce params", &[arrangement.groups as u32, span as u32, 0, 0])?,
            centers: zeroed("centres", 32 * cameras)?,
            topology: device.storage("topology", &arrangement.topology)?,
            vectors: zeroed("vectors", 16 * (STATE_VEC4 + SECTIONS * cameras))?,
            partials: zeroed("camera sums", 16 * arrangement.segments)?,
            block_sums: zeroed("block sums", 48 * arrangement.segments)?,
            sums: zeroed("sums", ROW_BYTES as usize * arrangement.groups)?,
            reduced: zeroed("reduced sums", ROW_BYTES as usize * rows)?,
            lengths: zeroed("lengths", 8 * arrangement.samples)?,
        };
        let chunks = arrangement.chunks.iter().map(|chunk| ChunkBuffers::new(device, chunk, rays));
        let mut resident = Self { chunks: chunks.collect::<Result<_, _>>()?, shared, rows, ready: Vec::new() };
        resident.bind(device, arrangement, cameras)?;
        Ok(resident)
    }

    fn bind(&mut self, device: &Device, arrangement: &Chunks, cameras: usize) -> Result<(), GpuError> {
        let pipelines = Pipelines::new(device, POSITIONING)?;
        for kernel in POSITIONING {
            let reach = reach(kernel);
            let mut dispatches = Vec::new();
            if matches!(reach, Reach::Cameras | Reach::One) {
                let groups = if matches!(reach, Reach::One) { 1 } else { cameras.div_ceil(64) };
                dispatches.push((pipelines.bind(device, kernel, &self.buffers_of(kernel, None))?, groups as u64));
            } else {
                for (chunk, buffers) in arrangement.chunks.iter().zip(&self.chunks) {
                    let groups = match reach {
                        Reach::Observations => chunk.observations.len().div_ceil(64),
                        Reach::Segments => chunk.segments.len(),
                        Reach::Samples => chunk.samples.len().div_ceil(64),
                        _ => chunk.groups(),
                    };
                    let bound = pipelines.bind(device, kernel, &self.buffers_of(kernel, Some(buffers)))?;
                    dispatches.push((bound, groups as u64));
                }
            }
            self.ready.push(Ready { name: kernel.name, dispatches });
        }
        let reduce = Pipelines::new(device, &[REDUCE])?;
        let shared = &self.shared;
        let bound = reduce.bind(device, &REDUCE, &[&shared.reduce_params, &shared.sums, &shared.reduced])?;
        self.ready.push(Ready { name: REDUCE.name, dispatches: vec![(bound, self.rows as u64)] });
        Ok(())
    }

    /// A kernel's buffers by the names of its variables.
    fn buffers_of<'b>(&'b self, kernel: &Kernel, chunk: Option<&'b ChunkBuffers>) -> Vec<&'b wgpu::Buffer> {
        let shared = &self.shared;
        let mut named = vec![
            ("settings", &shared.settings),
            ("centers", &shared.centers),
            ("topology", &shared.topology),
            ("vectors", &shared.vectors),
            ("partials", &shared.partials),
            ("block_sums", &shared.block_sums),
            ("sums", &shared.sums),
            ("lengths", &shared.lengths),
        ];
        if let Some(chunk) = chunk {
            named.extend([
                ("params", &chunk.params),
                ("points", &chunk.points),
                ("tracks", &chunk.tracks),
                ("by_point", &chunk.by_point),
                ("by_camera", &chunk.by_camera),
                ("rays", &chunk.rays),
                ("blocks", &chunk.blocks),
                ("segments", &chunk.segments),
                ("samples", &chunk.samples),
            ]);
        }
        kernel.bindings.iter().filter_map(|b| named.iter().find(|(name, _)| *name == b.name)).map(|n| n.1).collect()
    }

    /// Records kernels one after another, each over all chunks.
    pub(super) fn record(&self, encoder: &mut wgpu::CommandEncoder, kernels: &[Kernel]) -> Result<(), GpuError> {
        for kernel in kernels {
            let found = self.ready.iter().find(|ready| ready.name == kernel.name);
            let missing = || GpuError::Refused { reason: format!("kernel `{}` is not bound", kernel.name) };
            for (bound, groups) in &found.ok_or_else(missing)?.dispatches {
                bound.dispatch(encoder, *groups)?;
            }
        }
        Ok(())
    }

    /// Replaces what is known of the rays.
    pub(super) fn write_rays(&self, device: &Device, arrangement: &Chunks, rays: &[[f32; 4]]) {
        for (chunk, buffers) in arrangement.chunks.iter().zip(&self.chunks) {
            device.write(&buffers.rays, &rays[chunk.observations.clone()]);
        }
    }

    /// Bytes of all buffers.
    #[cfg(test)]
    pub(super) fn bytes(&self) -> u64 {
        let s = &self.shared;
        let shared = [
            &s.settings,
            &s.reduce_params,
            &s.centers,
            &s.topology,
            &s.vectors,
            &s.partials,
            &s.block_sums,
            &s.sums,
            &s.reduced,
            &s.lengths,
        ];
        let of_chunk = |c: &ChunkBuffers| -> u64 {
            let all = [
                &c.params,
                &c.points,
                &c.tracks,
                &c.by_point,
                &c.by_camera,
                &c.rays,
                &c.blocks,
                &c.segments,
                &c.samples,
            ];
            all.iter().map(|buffer| buffer.size()).sum()
        };
        shared.iter().map(|buffer| buffer.size()).sum::<u64>() + self.chunks.iter().map(of_chunk).sum::<u64>()
    }
}

impl ChunkBuffers {
    fn new(device: &Device, chunk: &Chunk, rays: &[[f32; 4]]) -> Result<Self, GpuError> {
        let params = Params {
            points: chunk.points.len() as u32,
            observations: chunk.observations.len() as u32,
            segments: chunk.segments.len() as u32,
            first_segment: chunk.first_segment as u32,
            first_group: chunk.first_group as u32,
            samples: chunk.samples.len() as u32,
        };
        let points = chunk.points.len() as u64;
        Ok(Self {
            params: device.uniform("params", &params.words())?,
            points: device.zeroed("points", 32 * points)?,
            tracks: device.storage("tracks", &chunk.tracks)?,
            by_point: device.storage("observations by point", &chunk.by_point)?,
            by_camera: device.storage("observations by camera", &chunk.by_camera)?,
            rays: device.storage("rays", &rays[chunk.observations.clone()])?,
            blocks: device.zeroed("point blocks", 64 * points)?,
            segments: device.storage("segments", &chunk.segments)?,
            samples: device.storage("samples", &chunk.samples)?,
        })
    }
}
