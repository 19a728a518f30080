//! What a solve costs, in numbers that do not depend on the machine: bytes, dispatches, submissions, read-backs.

use std::ops::Sub;

/// What has been asked of the device since a problem was made resident. Differences say what a step or a solve took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Steps computed, that is LM iterations, accepted or not.
    pub steps: u64,
    /// Command buffers submitted.
    pub submissions: u64,
    /// Kernels dispatched, those of PCG iterations included.
    pub dispatches: u64,
    /// PCG iterations queued; those queued behind the stop return at once.
    pub pcg_iterations: u64,
    /// Kernels dispatched for them.
    pub pcg_dispatches: u64,
    /// Times the host waited for the device's answer.
    pub read_backs: u64,
    /// Copies of the accepted state to the host, which nothing waits for.
    pub checkpoints: u64,
}

impl Sub for Counters {
    type Output = Self;

    fn sub(self, before: Self) -> Self {
        Self {
            steps: self.steps - before.steps,
            submissions: self.submissions - before.submissions,
            dispatches: self.dispatches - before.dispatches,
            pcg_iterations: self.pcg_iterations - before.pcg_iterations,
            pcg_dispatches: self.pcg_dispatches - before.pcg_dispatches,
            read_backs: self.read_backs - before.read_backs,
            checkpoints: self.checkpoints - before.checkpoints,
        }
    }
}

/// Bytes that a problem occupies on a device, by what they grow with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResidentBytes {
    /// Observations resident; those of tracks that cannot fix a point are left out.
    pub observations: u64,
    /// Arrays with a row for every observation.
    pub observation_bytes: u64,
    /// Arrays with a row for every point.
    pub point_bytes: u64,
    /// The rest: images, cameras, segments of images, vectors, sums.
    pub rest_bytes: u64,
    /// Mappable memory that the state is copied to after accepted steps.
    pub staging_bytes: u64,
}

impl ResidentBytes {
    /// All of it.
    pub fn total(&self) -> u64 {
        self.observation_bytes + self.point_bytes + self.rest_bytes + self.staging_bytes
    }

    /// Bytes that one more observation of a known point costs.
    pub fn per_observation(&self) -> f64 {
        self.observation_bytes as f64 / self.observations.max(1) as f64
    }
}
