//! A problem's buffers on a device, those of the whole and those of each chunk, and which a kernel gets by which name.

use super::chunk::{Chunk, POINT_BYTES};
use super::coarse::CoarseBuffers;
use super::layout::Layout;
use crate::gpu::kernels::Kernel;
use crate::gpu::sums::ROW_BYTES;
use crate::gpu::{Device, GpuError};

/// vec4f of state and number of sections, as in `vectors.wgsl`.
const STATE_VEC4: u64 = 4;
const SECTIONS: u64 = 10;
/// The same of a row of the coarse matrix's blocks: its part of Zᵀr and of the solution.
const COARSE_VEC4: u64 = 4;
/// Parts of a buffer are bound at multiples of this (WebGPU's `minStorageBufferOffsetAlignment` by default).
const ALIGN_BYTES: u64 = 256;
/// Rows of sums between the first rows of two chunks: a multiple of this.
pub(super) const ROW_ALIGN: u64 = ALIGN_BYTES / ROW_BYTES;

/// What all chunks share.
#[derive(Debug)]
pub(super) struct Buffers {
    /// The whole's parameters, then each chunk's, [`PARAMS_STRIDE`](super::resident::PARAMS_STRIDE) apart.
    pub(super) params: wgpu::Buffer,
    pub(super) reduce_params: wgpu::Buffer,
    pub(super) views: wgpu::Buffer,
    pub(super) intrinsics: wgpu::Buffer,
    pub(super) topology: wgpu::Buffer,
    pub(super) freedom: wgpu::Buffer,
    pub(super) priors: wgpu::Buffer,
    pub(super) partials: wgpu::Buffer,
    pub(super) block_sums: wgpu::Buffer,
    pub(super) group_sums: wgpu::Buffer,
    pub(super) inverses: wgpu::Buffer,
    pub(super) vectors: wgpu::Buffer,
    /// Sums of the operator, of the back-substitution and of the trial (or refresh).
    pub(super) product_sums: wgpu::Buffer,
    pub(super) step_sums: wgpu::Buffer,
    pub(super) trial_sums: wgpu::Buffer,
    pub(super) step_reduced: wgpu::Buffer,
    pub(super) trial_reduced: wgpu::Buffer,
    /// The preconditioner's second level.
    pub(super) coarse: CoarseBuffers,
}

/// What a chunk has alone.
#[derive(Debug)]
pub(super) struct ChunkBuffers {
    pub(super) points: wgpu::Buffer,
    pub(super) tracks: wgpu::Buffer,
    pub(super) by_point: wgpu::Buffer,
    pub(super) by_image: wgpu::Buffer,
    pub(super) image_order: wgpu::Buffer,
    pub(super) pixels: wgpu::Buffer,
    pub(super) residuals: wgpu::Buffer,
    pub(super) segments: wgpu::Buffer,
    pub(super) blocks: wgpu::Buffer,
    pub(super) changes: wgpu::Buffer,
}

/// A chunk's place among the rows of sums over points, and the bytes of its parameters.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkPlace {
    pub(super) first_row: u64,
    pub(super) rows: u64,
    /// Among the sums of exact blocks.
    pub(super) first_slot: u64,
    pub(super) slots: u64,
    /// A multiple of what offsets of bindings are aligned to, as are rows in steps of [`ROW_ALIGN`].
    pub(super) slot_bytes: u64,
    pub(super) params_offset: u64,
}

impl ChunkBuffers {
    pub(super) fn new(device: &Device, layout: &Layout, chunk: &Chunk) -> Result<Self, GpuError> {
        let (points, sizes) = (chunk.points.len() as u64, layout.sizes);
        let residual_bytes = 4 * (sizes.residual() * chunk.by_point.len()) as u64;
        let residuals = match sizes.depth {
            true => device.storage("residuals", &sizes.pack_depths(&chunk.depths, layout.depth_loss)),
            false => device.zeroed("residuals", residual_bytes),
        };
        Ok(Self {
            points: device.storage("points", &chunk.points)?,
            // Then where the observations of each end that count.
            tracks: device.storage("tracks", &[&chunk.tracks[..], &chunk.tracks[1..]].concat())?,
            by_point: device.storage("observations by point", &sizes.pack_by_point(&chunk.by_point))?,
            by_image: device.storage("observations by image", &chunk.by_image)?,
            image_order: device.storage("image order", &chunk.image_order)?,
            pixels: device.storage("pixels", &chunk.pixels)?,
            residuals: residuals?,
            segments: device.storage("segments", &chunk.segments)?,
            blocks: device.zeroed("point blocks", points * POINT_BYTES)?,
            changes: device.zeroed("point changes", points * 16)?,
        })
    }

    fn named(&self) -> [(&'static str, &wgpu::Buffer); 10] {
        [
            ("points", &self.points),
            ("tracks", &self.tracks),
            ("by_point", &self.by_point),
            ("by_image", &self.by_image),
            ("image_order", &self.image_order),
            ("pixels", &self.pixels),
            ("residuals", &self.residuals),
            ("segments", &self.segments),
            ("blocks", &self.blocks),
            ("changes", &self.changes),
        ]
    }

    pub(super) fn bytes(&self) -> u64 {
        self.named().iter().map(|(_, buffer)| buffer.size()).sum()
    }

    /// Of the arrays with a row for every observation.
    pub(super) fn observation_bytes(&self) -> u64 {
        let arrays = [&self.by_point, &self.by_image, &self.image_order, &self.pixels, &self.residuals];
        arrays.iter().map(|buffer| buffer.size()).sum()
    }

    /// Of the arrays with a row for every point.
    pub(super) fn point_bytes(&self) -> u64 {
        let arrays = [&self.points, &self.tracks, &self.blocks, &self.changes];
        arrays.iter().map(|buffer| buffer.size()).sum()
    }
}

impl Buffers {
    /// `rows` rows of sums over points, `reduced` of the second stage, parameters of `params_bytes`.
    pub(super) fn new(
        device: &Device,
        layout: &Layout,
        params_bytes: u64,
        [rows, span, reduced]: [u64; 3],
        group_slots: u64,
    ) -> Result<Self, GpuError> {
        let units = (layout.views.len() + layout.intrinsics.len()) as u64;
        let segments = layout.segments as u64;
        let sizes = layout.sizes;
        let words = |count: usize| 4 * count as u64;
        let rows_of_blocks = layout.plan.rows() as u64;
        let sums = |name| device.zeroed(name, rows * ROW_BYTES);
        Ok(Self {
            params: device.uniforms("params", params_bytes)?,
            reduce_params: device.uniform("reduce params", &[rows as u32, span as u32, 0, 0])?,
            views: device.storage("views", &layout.views_with_limits())?,
            intrinsics: device.storage("intrinsics", &sizes.pack(&layout.intrinsics).repeat(3))?,
            topology: device.storage("topology", &layout.topology)?,
            freedom: device.storage("freedom", &sizes.pack_units(&layout.freedom))?,
            priors: device.storage("priors", &sizes.pack_units(layout.priors.rows.as_flattened()))?,
            partials: device.zeroed("camera sums", segments * words(sizes.step()))?,
            block_sums: device.zeroed("block sums", segments * words(sizes.block_sums()))?,
            group_sums: device.zeroed("group sums", group_slots * words(sizes.group_sums()))?,
            inverses: device.zeroed("inverse blocks", units * words(sizes.side() * sizes.side()))?,
            vectors: device.zeroed(
                "vectors",
                16 * (STATE_VEC4 + COARSE_VEC4 * rows_of_blocks) + SECTIONS * units * words(sizes.params),
            )?,
            product_sums: sums("product sums")?,
            step_sums: sums("step sums")?,
            trial_sums: sums("trial sums")?,
            step_reduced: device.zeroed("reduced step sums", reduced * ROW_BYTES)?,
            trial_reduced: device.zeroed("reduced trial sums", reduced * ROW_BYTES)?,
            coarse: CoarseBuffers::new(device, &layout.plan)?,
        })
    }

    fn named(&self) -> [(&'static str, &wgpu::Buffer); 17] {
        [
            ("params", &self.params),
            ("reduce_params", &self.reduce_params),
            ("views", &self.views),
            ("intrinsics", &self.intrinsics),
            ("topology", &self.topology),
            ("freedom", &self.freedom),
            ("priors", &self.priors),
            ("partials", &self.partials),
            ("block_sums", &self.block_sums),
            ("group_sums", &self.group_sums),
            ("inverses", &self.inverses),
            ("vectors", &self.vectors),
            ("product sums", &self.product_sums),
            ("step sums", &self.step_sums),
            ("trial sums", &self.trial_sums),
            ("step reduced", &self.step_reduced),
            ("trial reduced", &self.trial_reduced),
        ]
    }

    pub(super) fn bytes(&self) -> u64 {
        self.named().iter().chain(&self.coarse.named()).map(|(_, buffer)| buffer.size()).sum()
    }

    /// A kernel's buffers by the names of its variables, those of a chunk included where it works on one. `sums` is the
    /// one name with a meaning by kernel; a kernel over a chunk's points binds the chunk's rows of it.
    pub(super) fn of<'a>(
        &'a self,
        kernel: &Kernel,
        chunk: Option<(&'a ChunkBuffers, ChunkPlace)>,
    ) -> Vec<wgpu::BufferBinding<'a>> {
        let sums = match kernel.name {
            "product_point" | "pcg_step" => &self.product_sums,
            "back_substitute" => &self.step_sums,
            _ => &self.trial_sums,
        };
        let part =
            |buffer, offset, bytes: u64| wgpu::BufferBinding { buffer, offset, size: wgpu::BufferSize::new(bytes) };
        let whole = |buffer: &'a wgpu::Buffer| part(buffer, 0, buffer.size());
        let place = chunk.map(|(_, place)| place);
        let of_chunk = chunk.map(|(buffers, _)| buffers.named());
        let one = |name: &str| match name {
            "params" => Some(part(&self.params, place.map_or(0, |p| p.params_offset), super::resident::PARAMS_BYTES)),
            "sums" => Some(place.map_or(whole(sums), |p| part(sums, p.first_row * ROW_BYTES, p.rows * ROW_BYTES))),
            "group_sums" => Some(place.map_or(whole(&self.group_sums), |p| {
                part(&self.group_sums, p.first_slot * p.slot_bytes, p.slots * p.slot_bytes)
            })),
            _ => {
                let named = self.named();
                let coarse = self.coarse.named();
                let mut all = of_chunk.iter().flatten().chain(&named).chain(&coarse);
                all.find(|(n, _)| *n == name).map(|&(_, buffer)| whole(buffer))
            }
        };
        kernel.bindings.iter().filter_map(|b| one(b.name)).collect()
    }
}
