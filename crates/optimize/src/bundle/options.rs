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
}
