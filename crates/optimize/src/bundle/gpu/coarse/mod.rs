//! The second level of the preconditioner on the device (source: `scale.md` §3): when it is assembled, and its inverse.
//!
//! The device sums `A = Zᵀ S Z`; the host reads it back, adds a shift, inverts it in `f64` and uploads the inverse, which
//! `pcg_step` applies. The points' part goes piece by piece, and the index of a piece is uploaded when its turn comes, so
//! that what stays on the device does not grow with the observations.

mod buffers;
mod piece;
mod plan;

pub(super) use buffers::CoarseBuffers;
pub(super) use piece::PieceWords;
pub(super) use plan::Plan;

use buffers::BLOCK_BYTES;
use plan::BLOCK;

use std::sync::Arc;

use super::chunk::Chunk;
use super::resident::Resident;
use crate::bundle::options::{Options, Preconditioner};
use crate::bundle::problem::Problem;
use crate::gpu::{Device, GpuError, Halt, ReadBack, Turns};
use crate::lm::Observer;
use crate::reduced::coarse::{
    MIN_IMAGES, Memberships, REBUILD_AFTER, STEPS_AT_LIMIT, invert, memberships as cluster_memberships,
};

/// Relative shift of the diagonal: what sums in `f32` may have lost (source: `scale.md` §3.4).
const SHIFT: f64 = 1e-6;

/// Clusters and weights of a problem's images; none where the second level is not wanted or there is nothing to eliminate.
pub(super) fn memberships(problem: &Problem, preconditioner: Preconditioner) -> Memberships {
    let images = problem.cam_from_world.len();
    if preconditioner == Preconditioner::SchurJacobi || problem.fixed_points {
        return vec![Vec::new(); images];
    }
    cluster_memberships(images, &problem.track_start, &problem.observation_image)
}

/// The second level of a problem.
#[derive(Debug)]
pub(super) struct Coarse {
    plan: Arc<Plan>,
    read_back: ReadBack,
    wanted: bool,
    may_start: bool,
    steps_at_limit: usize,
    /// Steps since it was assembled, and how many had been accepted then.
    built: Option<(usize, usize)>,
}

impl Coarse {
    pub(super) fn new(device: &Device, plan: &Arc<Plan>, options: &Options) -> Result<Self, GpuError> {
        let wanted = match options.preconditioner {
            Preconditioner::SchurJacobi => false,
            Preconditioner::TwoLevel => true,
            Preconditioner::Auto => plan.num_images() >= MIN_IMAGES,
        };
        Ok(Self {
            read_back: device.read_back("coarse matrix", plan.blocks.len() as u64 * BLOCK_BYTES)?,
            wanted: wanted && plan.clusters > 0,
            may_start: options.preconditioner == Preconditioner::Auto && plan.clusters > 0,
            plan: plan.clone(),
            steps_at_limit: 0,
            built: None,
        })
    }

    /// Whether the matrix is to be made anew before a step, `accepted` steps after the start. A refused step left the
    /// state as it was: what changed is the damping, and for that a new matrix is not worth the wait.
    pub(super) fn is_due(&mut self, accepted: usize) -> bool {
        if !self.wanted {
            return false;
        }
        let due = self.built.is_none_or(|(age, then)| age >= REBUILD_AFTER && accepted > then);
        self.built = Some(match self.built {
            Some((age, then)) if !due => (age + 1, then),
            _ => (1, accepted),
        });
        due
    }

    /// Learns what a step took.
    pub(super) fn took(&mut self, iterations: usize, limit: usize) {
        self.steps_at_limit = if iterations >= limit { self.steps_at_limit + 1 } else { 0 };
        self.wanted |= self.may_start && self.steps_at_limit >= STEPS_AT_LIMIT;
    }

    /// Assembles and inverts the matrix at the linearisation and damping on the device. `submitted` is told of every
    /// submission.
    pub(super) async fn assemble(
        &self,
        device: &Device,
        resident: &Resident,
        chunks: &[Chunk],
        mut submitted: impl FnMut(),
        turns: &Turns,
        observer: &mut dyn Observer,
    ) -> Result<(), Halt> {
        let buffers = &resident.buffers.coarse;
        let mut encoder = device.encoder();
        resident.record(&mut encoder, "coarse_modes")?;
        resident.record(&mut encoder, "coarse_base")?;
        for piece in &self.plan.pieces {
            submitted();
            device.submit(encoder);
            let mut words = PieceWords::new(&self.plan, &chunks[piece.chunk], piece);
            words.pad(self.plan.limits.entries);
            buffers.upload(device, &words);
            encoder = device.encoder();
            resident.record_on_chunk(&mut encoder, piece.chunk, "coarse_entry")?;
            resident.record(&mut encoder, "coarse_pair")?;
            resident.record(&mut encoder, "coarse_subtract")?;
            turns.take(device, &mut encoder, self.plan.limits.entries, observer).await?;
        }
        let bytes = self.plan.blocks.len() as u64 * BLOCK_BYTES;
        self.read_back.copy(&mut encoder, &buffers.matrix, 0, 0, bytes);
        submitted();
        device.submit(encoder);
        let blocks: Vec<[f32; BLOCK * BLOCK]> = self.read_back.get(device, self.plan.blocks.len()).await?;
        let mut words = vec![0f32; 4];
        if let Some(inverse) = self.inverse(&blocks) {
            words[0] = 1.0;
            words.extend(inverse);
        }
        device.write(&buffers.inverse, &words);
        Ok(device.check()?)
    }

    /// A⁻¹ by rows, 0 for columns without content; `None` where no shift makes the matrix positive definite.
    fn inverse(&self, blocks: &[[f32; BLOCK * BLOCK]]) -> Option<Vec<f32>> {
        let dim = BLOCK * self.plan.rows();
        let mut full = vec![0.0f64; dim * dim];
        for (&(row, column), block) in self.plan.blocks.iter().zip(blocks) {
            for (k, &value) in block.iter().enumerate() {
                let (i, j) = (BLOCK * row as usize + k / BLOCK, BLOCK * column as usize + k % BLOCK);
                full[i * dim + j] = f64::from(value);
                if row != column {
                    full[j * dim + i] = f64::from(value);
                }
            }
        }
        // Empty columns, the eighth of every cluster at least, would cost half as much again.
        let kept: Vec<usize> = (0..dim).filter(|&k| full[k * dim + k] > 0.0).collect();
        let n = kept.len();
        if n == 0 {
            return None;
        }
        let at = |i: usize, j: usize| full[kept[i] * dim + kept[j]];
        let symmetric = |k: usize| 0.5 * (at(k / n, k % n) + at(k % n, k / n));
        let small = invert((0..n * n).map(symmetric).collect(), n, SHIFT)?;
        let mut inverse = vec![0f32; dim * dim];
        for (k, value) in small.into_iter().enumerate() {
            inverse[kept[k / n] * dim + kept[k % n]] = value as f32;
        }
        inverse.iter().all(|v| v.is_finite()).then_some(inverse)
    }
}
