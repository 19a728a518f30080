//! A problem on a device: its kernels bound to its buffers, chunk by chunk.

use std::cell::Cell;

use super::buffers::{Buffers, ChunkBuffers, ChunkPlace, ROW_ALIGN};
use super::chunk::Chunk;
use super::counters::ResidentBytes;
use super::exact::spans;
use super::layout::Layout;
use super::records::Params;
use crate::gpu::kernels::{self, Kernel};
use crate::gpu::{Bound, Device, GpuError, Pipelines, sums};

/// Points that one workgroup handles.
const POINT_GROUP: u64 = 64;
/// Bytes of the uniform `Params`, and from one to the next (WebGPU's `minUniformBufferOffsetAlignment` by default).
pub(super) const PARAMS_BYTES: u64 = size_of::<[u32; Params::WORDS]>() as u64;
const PARAMS_STRIDE: u64 = 256;

/// What a kernel's workgroups stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extent {
    /// 64 points of a chunk.
    Points,
    /// 64 observations of a chunk.
    Observations,
    /// A segment of a chunk.
    Segments,
    /// A span of a chunk's points and a camera with an exact block.
    Groups,
    /// 64 entries of a piece of a chunk's points.
    Entries,
    /// Entries of a piece that one workgroup pairs.
    EntrySegments,
    /// A block of the coarse matrix.
    CoarseBlocks,
    /// A cluster of images.
    Clusters,
    /// 64 images or cameras.
    UnitGroups,
    /// An image or a camera.
    Units,
    /// One workgroup for all.
    One,
}

impl Extent {
    fn of(kernel: &Kernel) -> Self {
        match kernel.name {
            "reweight" => Self::Observations,
            "compact_image" | "linearize_camera" | "precondition_camera" | "product_camera" => Self::Segments,
            "precondition_group" => Self::Groups,
            "coarse_modes" => Self::Clusters,
            "coarse_base" | "coarse_subtract" => Self::CoarseBlocks,
            "coarse_entry" => Self::Entries,
            "coarse_pair" => Self::EntrySegments,
            "scale_camera" | "step_camera" | "change_camera" | "commit_camera" => Self::UnitGroups,
            "precondition_factor" => Self::Units,
            "pcg_start" | "pcg_step" | "prior_camera" => Self::One,
            _ => Self::Points,
        }
    }

    fn is_of_chunk(self) -> bool {
        matches!(self, Self::Points | Self::Observations | Self::Segments | Self::Groups | Self::Entries)
    }
}

/// A kernel with its workgroups.
#[derive(Debug)]
struct Ready {
    name: &'static str,
    bound: Bound,
    groups: u64,
}

/// A problem on a device.
#[derive(Debug)]
pub(super) struct Resident {
    pub(super) buffers: Buffers,
    pub(super) chunks: Vec<ChunkBuffers>,
    /// The whole's; a chunk's differ in its counts.
    pub(super) params: Params,
    /// Points, observations and segments of each chunk, and where its sums go.
    counts: Vec<[u32; 3]>,
    places: Vec<ChunkPlace>,
    /// Rows of the second stage of the sums over points; those of the first are `params.point_groups`.
    pub(super) reduced: u64,
    /// Kernels of the whole, and those of each chunk.
    whole: Vec<Ready>,
    by_chunk: Vec<Vec<Ready>>,
    dispatches: Cell<u64>,
}

impl Resident {
    pub(super) fn new(device: &Device, layout: &Layout, mut params: Params) -> Result<Self, GpuError> {
        let mut places = Vec::with_capacity(layout.chunks.len());
        let (mut rows, mut slots) = (0u64, 0u64);
        for (k, chunk) in (1u64..).zip(&layout.chunks) {
            let first_row = rows.next_multiple_of(ROW_ALIGN);
            let own = (chunk.points.len() as u64).div_ceil(POINT_GROUP);
            let own_slots = (spans(chunk) * layout.exact_cameras) as u64;
            places.push(ChunkPlace {
                first_row,
                rows: own,
                first_slot: slots,
                slots: own_slots,
                slot_bytes: 4 * layout.sizes.group_sums() as u64,
                params_offset: k * PARAMS_STRIDE,
            });
            slots += own_slots;
            rows = first_row + own;
        }
        let (span, reduced) = sums::spans(rows);
        let chunks =
            layout.chunks.iter().map(|c| ChunkBuffers::new(device, layout, c)).collect::<Result<Vec<_>, _>>()?;
        let counts_of = |c: &Chunk| [c.points.len(), c.by_point.len(), c.segments.len()].map(|n| n as u32);
        let counts: Vec<[u32; 3]> = layout.chunks.iter().map(counts_of).collect();
        let total = |k: usize| counts.iter().map(|c| c[k]).sum::<u32>();
        params.points = total(0);
        params.observations = total(1);
        params.segments = total(2);
        params.images = layout.views.len() as u32;
        params.cameras = layout.intrinsics.len() as u32;
        params.cell = layout.lattice.cell as f32;
        params.point_groups = rows as u32;
        params.big_cameras = layout.big_cameras as u32;
        let params_bytes = PARAMS_STRIDE * (1 + chunks.len() as u64);
        let buffers = Buffers::new(device, layout, params_bytes, [rows, span, reduced], slots)?;

        let pipelines = Pipelines::for_variant(device, kernels::BUNDLE, layout.variant)?;
        let units = u64::from(params.images) + u64::from(params.cameras);
        let ready = |kernel: &Kernel, chunk: Option<usize>| {
            let of_chunk = chunk.map(|c| (&chunks[c], places[c]));
            let [points, observations, segments]: [u64; 3] = chunk.map_or([0; 3], |c| counts[c].map(u64::from));
            let groups = match Extent::of(kernel) {
                Extent::Points => points.div_ceil(POINT_GROUP),
                Extent::Observations => observations.div_ceil(64),
                Extent::Segments => segments,
                Extent::Groups => chunk.map_or(0, |c| places[c].slots),
                Extent::Entries => (layout.plan.limits.entries as u64).div_ceil(64),
                Extent::EntrySegments => layout.plan.limits.segments as u64,
                Extent::CoarseBlocks => layout.plan.blocks.len() as u64,
                Extent::Clusters => layout.plan.clusters as u64,
                Extent::UnitGroups => units.div_ceil(64),
                Extent::Units => units,
                Extent::One => 1,
            };
            let bound = pipelines.bind_parts(device, kernel, &buffers.of(kernel, of_chunk))?;
            Ok::<_, GpuError>(Ready { name: kernel.name, bound, groups })
        };
        let bundle = || kernels::BUNDLE.iter().filter(|k| k.name != kernels::REDUCE.name);
        let whole = bundle().filter(|k| !Extent::of(k).is_of_chunk()).map(|k| ready(k, None));
        let mut whole = whole.collect::<Result<Vec<_>, _>>()?;
        for (name, rows, sums) in [
            ("reduce step", &buffers.step_sums, &buffers.step_reduced),
            ("reduce trial", &buffers.trial_sums, &buffers.trial_reduced),
        ] {
            let bound = pipelines.bind(device, &kernels::REDUCE, &[&buffers.reduce_params, rows, sums])?;
            whole.push(Ready { name, bound, groups: reduced });
        }
        let of_chunk = |c| bundle().filter(|k| Extent::of(k).is_of_chunk()).map(|k| ready(k, Some(c))).collect();
        let by_chunk = (0..chunks.len()).map(of_chunk).collect::<Result<Vec<Vec<_>>, _>>()?;
        let resident =
            Self { buffers, chunks, params, counts, places, reduced, whole, by_chunk, dispatches: Cell::new(0) };
        resident.write_params(device);
        Ok(resident)
    }

    /// Uploads the parameters, those of the chunks included.
    pub(super) fn write_params(&self, device: &Device) {
        device.write(&self.buffers.params, &self.params_words());
    }

    /// What is uploaded.
    fn params_words(&self) -> Vec<u32> {
        let mut words = Vec::with_capacity((1 + self.counts.len()) * (PARAMS_STRIDE / 4) as usize);
        let of_chunk = |(&[points, observations, segments], place): (&[u32; 3], &ChunkPlace)| Params {
            points,
            observations,
            segments,
            point_groups: place.rows as u32,
            ..self.params
        };
        let all = std::iter::once(self.params).chain(self.counts.iter().zip(&self.places).map(of_chunk));
        for params in all {
            words.extend(params.words());
            words.resize(words.len().next_multiple_of((PARAMS_STRIDE / 4) as usize), 0);
        }
        words
    }

    /// For traces: workgroups of a kernel on the first chunk or on the whole, its buffers, and the parameters' words.
    #[cfg(test)]
    pub(super) fn bound(&self, kernel: &Kernel) -> Option<(u64, Vec<wgpu::BufferBinding<'_>>, Vec<u32>)> {
        let of_chunk = Extent::of(kernel).is_of_chunk();
        let ready = if of_chunk { self.by_chunk.first()? } else { &self.whole };
        let groups = ready.iter().find(|r| r.name == kernel.name)?.groups;
        let bindings = self.buffers.of(kernel, of_chunk.then_some((self.chunks.first()?, *self.places.first()?)));
        let first = if of_chunk { PARAMS_STRIDE as usize / 4 } else { 0 };
        Some((groups, bindings, self.params_words()[first..first + Params::WORDS].to_vec()))
    }

    /// Records a kernel over the whole problem.
    pub(super) fn record(&self, encoder: &mut wgpu::CommandEncoder, name: &'static str) -> Result<(), GpuError> {
        match self.whole.iter().find(|r| r.name == name) {
            Some(ready) => self.dispatch(encoder, ready),
            None => self.record_by_chunk(encoder, &[name]),
        }
    }

    /// Records kernels one after the other on each chunk, while its arrays are in the caches.
    pub(super) fn record_by_chunk(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        names: &[&'static str],
    ) -> Result<(), GpuError> {
        for chunk in &self.by_chunk {
            for name in names {
                let missing = || GpuError::Refused { reason: format!("kernel `{name}` is not bound to chunks") };
                let ready = chunk.iter().find(|r| r.name == *name).ok_or_else(missing)?;
                self.dispatch(encoder, ready)?;
            }
        }
        Ok(())
    }

    /// Records a kernel on one chunk.
    pub(super) fn record_on_chunk(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        chunk: usize,
        name: &'static str,
    ) -> Result<(), GpuError> {
        let missing = || GpuError::Refused { reason: format!("kernel `{name}` is not bound to chunk {chunk}") };
        let kernels = self.by_chunk.get(chunk);
        let ready = kernels.and_then(|kernels| kernels.iter().find(|r| r.name == name)).ok_or_else(missing)?;
        self.dispatch(encoder, ready)
    }

    fn dispatch(&self, encoder: &mut wgpu::CommandEncoder, ready: &Ready) -> Result<(), GpuError> {
        self.dispatches.set(self.dispatches.get() + u64::from(ready.groups > 0));
        ready.bound.dispatch(encoder, ready.groups)
    }

    /// Kernels dispatched so far.
    pub(super) fn dispatches(&self) -> u64 {
        self.dispatches.get()
    }

    /// Bytes of all buffers.
    pub(super) fn bytes(&self) -> ResidentBytes {
        let sum = |of: fn(&ChunkBuffers) -> u64| self.chunks.iter().map(of).sum::<u64>();
        let (observation_bytes, point_bytes) = (sum(ChunkBuffers::observation_bytes), sum(ChunkBuffers::point_bytes));
        ResidentBytes {
            observations: u64::from(self.params.observations),
            observation_bytes,
            point_bytes,
            rest_bytes: self.buffers.bytes() + sum(ChunkBuffers::bytes) - observation_bytes - point_bytes,
            staging_bytes: 0,
        }
    }
}
