//! Buffers of the coarse space: a problem's, and those of one piece of points.

use super::piece::PieceWords;
use super::plan::{BLOCK, Plan};
use crate::gpu::{Device, GpuError};

/// Bytes of an 8 × 8 block, and of an entry's 3 × 8 factor.
pub(super) const BLOCK_BYTES: u64 = 4 * (BLOCK * BLOCK) as u64;
const FACTOR_BYTES: u64 = 4 * (3 * BLOCK) as u64;

/// See the module. Without clusters all are as small as a binding may be.
#[derive(Debug)]
pub(in super::super) struct CoarseBuffers {
    pub(in super::super) modes: wgpu::Buffer,
    blocks: wgpu::Buffer,
    pub(in super::super) matrix: wgpu::Buffer,
    /// A vec4 that says whether there is one, then A⁻¹.
    pub(in super::super) inverse: wgpu::Buffer,
    entries: wgpu::Buffer,
    pub(in super::super) factors: wgpu::Buffer,
    piece: wgpu::Buffer,
    pub(in super::super) partials: wgpu::Buffer,
}

impl CoarseBuffers {
    pub(in super::super) fn new(device: &Device, plan: &Plan) -> Result<Self, GpuError> {
        let dim = (BLOCK * plan.rows()) as u64;
        let limits = plan.limits;
        Ok(Self {
            modes: device.storage("modes", &plan.modes())?,
            blocks: device.storage("coarse blocks", &plan.block_words())?,
            matrix: device.zeroed("coarse matrix", plan.blocks.len() as u64 * BLOCK_BYTES)?,
            inverse: device.zeroed("coarse inverse", 16 + 4 * dim * dim)?,
            entries: device.zeroed("coarse entries", 32 * limits.entries as u64)?,
            factors: device.zeroed("coarse factors", FACTOR_BYTES * limits.entries as u64)?,
            piece: device.zeroed("coarse piece", 4 * limits.words as u64)?,
            partials: device.zeroed("coarse partials", limits.partials as u64 * BLOCK_BYTES)?,
        })
    }

    /// Uploads the index of a piece.
    pub(in super::super) fn upload(&self, device: &Device, piece: &PieceWords) {
        device.write(&self.entries, &piece.entries);
        device.write(&self.piece, &piece.words);
    }

    /// By the names of the kernels' variables.
    pub(in super::super) fn named(&self) -> [(&'static str, &wgpu::Buffer); 8] {
        [
            ("modes", &self.modes),
            ("coarse_blocks", &self.blocks),
            ("coarse_matrix", &self.matrix),
            ("coarse_inverse", &self.inverse),
            ("coarse_entries", &self.entries),
            ("coarse_factors", &self.factors),
            ("coarse_piece", &self.piece),
            ("coarse_partials", &self.partials),
        ]
    }
}
