//! How to solve a bundle adjustment problem.

use crate::active::Activation;
use crate::lm::LmOptions;
use crate::reduced::PcgOptions;

/// How the reduced camera system is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// Cholesky or PCG, by the cost estimate of `scale.md` §5.
    #[default]
    Auto,
    /// Form the system and factorise it.
    Cholesky,
    /// Form the system and iterate on it.
    PcgExplicit,
    /// Iterate without forming it.
    PcgImplicit,
}

/// What PCG is preconditioned with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preconditioner {
    /// The second level for 60 images or more, and for fewer once PCG has come to its limit three times in a row.
    #[default]
    Auto,
    /// The diagonal blocks of the reduced system alone: one per image, one per shared camera.
    SchurJacobi,
    /// With a coarse space of similarities of clusters of images on top (source: `scale.md` §3).
    TwoLevel,
}

/// Options of [`super::solve`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// The loop.
    pub lm: LmOptions,
    /// Which observations count.
    pub activation: Activation,
    /// How steps are computed.
    pub solver: Solver,
    /// When PCG stops.
    pub pcg: PcgOptions,
    /// What PCG is preconditioned with.
    pub preconditioner: Preconditioner,
}
