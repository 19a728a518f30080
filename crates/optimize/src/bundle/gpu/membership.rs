//! Which observations count, on a device: flags in its records, set by kernels; the host lowers the limit and decides when
//! points are worth a closer look (source: `solver.md` §5.4).

use super::records::{ALL, FIRST_PASS, FROM_SCRATCH, HIDDEN, OUT, TRUNCATED, VALID_AT_START};
use super::system::GpuSystem;
use crate::active::Activation;
use crate::extraction::{Progress, ResidualLimit};
use crate::gpu::GpuError;
use crate::lm::{Evaluation, Observer};
use crate::loss::Loss;

/// Larger than any sum of losses: the limit before anything is known.
const NO_LIMIT: f32 = 1e37;

/// Observations are compacted while more than this share is out; below, skipping them is cheaper than moving them
/// (source: `solver.md` §5.4).
pub(super) const COMPACT_SHARE: f64 = 0.3;

/// What the host knows of the set.
#[derive(Debug)]
pub(super) struct Membership {
    activation: Activation,
    limit: ResidualLimit,
    progress: Progress,
    started: bool,
    /// Σ ln s over the observations that count at the tried state, and how many.
    pub(super) tried: (f64, usize),
    /// The same at the accepted state, where the limit has not followed it yet.
    accepted: Option<(f64, usize)>,
    /// Whether residuals have been carried along for long enough.
    pub(super) from_scratch: bool,
    /// See [`COMPACT_SHARE`].
    pub(super) compact_share: f64,
    /// Whether what counts shall lie, and does lie, before what does not.
    shall_be_compact: bool,
    is_compact: bool,
}

/// `params.activation`.
pub(super) fn activation_word(activation: Activation) -> u32 {
    match activation {
        Activation::All => ALL,
        Activation::ValidAtStart => VALID_AT_START,
        Activation::Truncated { .. } | Activation::Dynamic { .. } => TRUNCATED,
    }
}

impl Membership {
    pub(super) fn new(activation: Activation, loss: Loss) -> Self {
        Self {
            activation,
            limit: ResidualLimit::new(activation, loss),
            progress: Progress::START,
            started: false,
            tried: (0.0, 0),
            accepted: None,
            from_scratch: false,
            compact_share: COMPACT_SHARE,
            shall_be_compact: false,
            is_compact: false,
        }
    }

    /// Whether observations may return.
    pub(super) fn may_return(&self) -> bool {
        activation_word(self.activation) == TRUNCATED
    }

    fn is_dynamic(&self) -> bool {
        matches!(self.activation, Activation::Dynamic { .. })
    }

    /// The tried state is the accepted one.
    pub(super) fn accept(&mut self) {
        self.accepted = Some(self.tried);
    }
}

impl GpuSystem<'_> {
    /// Decides the set at the accepted state, and gives its cost. Points may be moved before; F falls or stays.
    pub(super) async fn decide(&mut self, observer: &mut dyn Observer) -> Result<Evaluation, GpuError> {
        if !self.membership.started {
            if self.membership.is_dynamic() {
                // Everything that may enter, to see which limit suits it.
                self.prepare(NO_LIMIT, FIRST_PASS);
                let mut encoder = self.device().encoder();
                self.record_through(&mut encoder, "refresh", observer).await?;
                let totals = self.totals_of(encoder).await?;
                self.membership.limit.follow(totals[4], totals[3] as usize);
            }
            self.prepare(self.membership.limit.tau as f32, FIRST_PASS);
            let mut encoder = self.device().encoder();
            self.record_through(&mut encoder, "refresh", observer).await?;
            self.device().submit(encoder);
            self.membership.started = true;
        } else if let Some((sum_of_logs, count)) = self.membership.accepted.take() {
            self.membership.limit.follow(sum_of_logs, count);
        }
        let flags = if std::mem::take(&mut self.membership.from_scratch) { FROM_SCRATCH } else { 0 };
        self.prepare(self.membership.limit.tau as f32, flags);
        let mut encoder = self.device().encoder();
        if self.membership.is_dynamic() {
            self.record_through(&mut encoder, "revive", observer).await?;
        }
        self.record_through(&mut encoder, "refresh", observer).await?;
        let totals = self.totals_of(encoder).await?;
        let outside = f64::from(self.resident.params.observations) - totals[3];
        let share = outside / f64::from(self.resident.params.observations.max(1));
        self.membership.shall_be_compact = share > self.membership.compact_share;
        let cost = 0.5 * (totals[1] + self.tau() * outside) + self.prior_cost();
        self.membership.progress.note(cost);
        Ok(Evaluation { cost, active: totals[3] as usize })
    }

    /// Records the compaction of both orders, once weights are new, where there is any to do or to undo.
    pub(super) fn queue_compaction(&mut self, encoder: &mut wgpu::CommandEncoder) -> Result<(), GpuError> {
        let compact = self.membership.shall_be_compact;
        if compact || self.membership.is_compact {
            self.resident.params.compact = compact;
            self.resident.write_params(self.device());
            self.resident.record_by_chunk(encoder, &["compact_point", "compact_image"])?;
            self.membership.is_compact = compact;
        }
        Ok(())
    }

    pub(super) fn prepare(&mut self, tau: f32, refresh_flags: u32) {
        let params = &mut self.resident.params;
        (params.tau, params.refresh_flags) = (tau, refresh_flags);
        params.revive_all = self.membership.progress.is_time_for_all();
        self.resident.write_params(self.device());
    }

    /// What an observation outside the set is charged.
    pub(super) fn tau(&self) -> f64 {
        f64::from(self.resident.params.tau)
    }

    /// Says which images do not see which points for the time being, whatever the geometry says: `hides(image, point)`,
    /// in force from the next refresh.
    ///
    /// # Errors
    /// A device that was lost.
    pub async fn occlude(&self, hides: impl Fn(usize, usize) -> bool) -> Result<(), GpuError> {
        for (chunk, buffers) in self.layout.chunks.iter().zip(&self.resident.chunks) {
            let stride = self.layout.sizes.by_point();
            let mut by_point: Vec<u32> =
                self.device().download(&buffers.by_point, stride * chunk.by_point.len()).await?;
            for (p, track) in chunk.tracks.windows(2).enumerate() {
                let words = stride * track[0] as usize..stride * track[1] as usize;
                for word in by_point[words].iter_mut().step_by(stride) {
                    let image = *word & !(OUT | HIDDEN);
                    let hidden = hides(image as usize, chunk.first_point + p);
                    *word = (*word & !HIDDEN) | if hidden { HIDDEN } else { 0 };
                }
            }
            self.device().write(&buffers.by_point, &by_point);
        }
        Ok(())
    }
}
