//! What can be set; the defaults are the ones that `reference/global-positioning.md` measured on real scenes.

use super::normal::LinearSolver;
use crate::lm::LmOptions;

/// Settings of [`super::solve`]. The defaults suit every scene that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Huber threshold on `‖v − s d‖ = sin(angle)` of free observations. 0.01 is 0.6°: at GLOMAP's 0.1 mismatches of 5°
    /// pass for inliers and positions are 3 to 10 times worse (`global-positioning.md` §4).
    pub huber: f64,
    /// The same for pinned observations, where the residual holds the relative error of the depth too.
    pub huber_pinned: f64,
    /// Least scale, in units of the median one: what an observation behind its camera gets.
    pub min_scale: f64,
    /// The loop of variable projection. Its tolerance of 1e-3, asked for twice running, halves the work of 1e-4 for
    /// positions within 2 % (castle-P19 10.9 against 10.7, bonsai292 7.5 against 7.5 thousandths of the extent); what is
    /// not determined by the rays is better left to bundle adjustment (`solver.md` §3.3).
    pub lm: LmOptions,
    /// How linear systems are solved.
    pub linear_solver: LinearSolver,
    /// Whether a suspicious result is tried again from the LUD start and, if still suspicious, without its worst
    /// observations.
    pub retry: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            huber: 0.01,
            huber_pinned: 0.1,
            min_scale: 1e-5,
            lm: LmOptions {
                max_iterations: 60,
                relative_decrease_tolerance: 1e-3,
                // Residuals are angles: below a nanoradian nothing moves.
                scaled_step_tolerance: 1e-9,
                ..LmOptions::default()
            },
            linear_solver: LinearSolver::Auto,
            retry: true,
        }
    }
}
