//! How a problem lies on a device.

use super::chunk::{ChunkLimits, POINT_BYTES};
use super::sizes::Sizes;
use crate::gpu::Device;

/// Choices that change speed and memory, and results by rounding only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Residency {
    /// Points are split into chunks of at most this many observations, fewer where the device's bindings are small; a
    /// longer track is a chunk of its own. Each chunk costs two more dispatches a PCG iteration, and its points stay in
    /// the GPU's last cache: 1–2 million (source: `solver.md` §2.6).
    pub chunk_observations: usize,
}

impl Default for Residency {
    fn default() -> Self {
        Self { chunk_observations: 1 << 21 }
    }
}

impl Residency {
    pub(super) fn limits(&self, device: &Device, sizes: Sizes) -> ChunkLimits {
        let fits = |bytes: u64| usize::try_from(device.max_binding_bytes() / bytes).unwrap_or(usize::MAX);
        let most_observations = fits(4 * sizes.residual() as u64);
        ChunkLimits {
            points: fits(POINT_BYTES),
            observations: self.chunk_observations.min(most_observations),
            most_observations,
            segments: fits(4 * sizes.block_sums() as u64),
        }
    }
}
