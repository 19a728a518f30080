//! Choosing and running the solver of the reduced system.

use std::sync::Arc;

use epipole_geometry::camera::Real;
use glam::DVec3;

use super::coarse::SecondLevel;
use super::elimination::{DampedPoint, subtract_points};
use super::implicit::ImplicitOperator;
use super::linearization::Linearization;
use super::normal::CameraNormal;
use super::structure::Structure;
use crate::bundle::options::{Options, Solver};
use crate::error::OptimizeError;
use crate::lm::Observer;
use crate::reduced::{BlockJacobi, BlockMatrix, BlockPattern, Cholesky, LinearOperator, PcgOptions, pcg};

/// Block products per second of the assembly, on one core (measured on bonsai292; `scale.md` §4 had 20e6).
const PAIRS_PER_SECOND: f64 = 40e6;
/// Operations per second of the factorisation, on one core (measured on bonsai292; `scale.md` §4 had 25e9).
const FLOPS_PER_SECOND: f64 = 40e9;
/// Observations per second of one implicit product in `f64`, on one core (measured on bonsai292: two passes, one by point
/// and one by image, both bound by memory; the fused single pass of `scale.md` §4 had 25–35e6).
const OBSERVATIONS_PER_SECOND: f64 = 11e6;
/// Products that one inexact step takes on graphs that suit PCG (source: `scale.md` §5).
const PCG_PRODUCTS: f64 = 20.0;
/// Exact steps save iterations: they may cost this much more (source: `scale.md` §5).
const EXACT_BONUS: f64 = 1.5;

/// A solver with its memory.
#[derive(Debug)]
pub(super) struct ReducedSolver {
    kind: Kind,
    /// The whole matrix, or its diagonal blocks where it is never formed.
    matrix: BlockMatrix,
    pcg: PcgOptions,
    second_level: SecondLevel,
}

#[derive(Debug)]
enum Kind {
    Cholesky(Box<Cholesky>),
    PcgExplicit,
    PcgImplicit,
}

impl ReducedSolver {
    pub(super) fn new(structure: &Structure, options: &Options) -> Result<Self, OptimizeError> {
        let diagonal = || Arc::new(BlockPattern::diagonal(&structure.layout));
        let full = || Arc::new(BlockPattern::from_incidence(&structure.layout, &structure.incidence));
        let (kind, pattern) = match options.solver {
            Solver::PcgImplicit => (Kind::PcgImplicit, diagonal()),
            Solver::PcgExplicit => (Kind::PcgExplicit, full()),
            Solver::Cholesky => {
                let pattern = full();
                (Kind::Cholesky(Box::new(Cholesky::new(&pattern)?)), pattern)
            }
            Solver::Auto => {
                let assembly = structure.incidence.num_pairs() as f64 / PAIRS_PER_SECOND;
                let limit = EXACT_BONUS * PCG_PRODUCTS * structure.image.len() as f64 / OBSERVATIONS_PER_SECOND;
                // Small problems are not worth a choice: any factor takes less than a tenth of a second.
                let limit = limit.max(0.1);
                let exact = if assembly < limit { Some(full()) } else { None };
                let exact = match exact {
                    Some(pattern) => {
                        let cholesky = Cholesky::new(&pattern)?;
                        let fast = assembly + cholesky.flops() / FLOPS_PER_SECOND < limit;
                        fast.then_some((Kind::Cholesky(Box::new(cholesky)), pattern))
                    }
                    None => None,
                };
                exact.unwrap_or_else(|| (Kind::PcgImplicit, diagonal()))
            }
        };
        let second_level = SecondLevel::new(structure, options);
        Ok(Self { kind, matrix: BlockMatrix::zeros(pattern), pcg: options.pcg, second_level })
    }

    /// The camera step and the products it took; `None` where there is no solution, or the observer asks to stop.
    pub(super) async fn solve<T: Real, const ROWS: usize>(
        &mut self,
        structure: &Structure,
        linearization: &Linearization<T, ROWS>,
        normal: &CameraNormal,
        damped: &[DampedPoint],
        centers: &[DVec3],
        lambda: f64,
        observer: &mut dyn Observer,
    ) -> Option<(Vec<f64>, usize)> {
        self.matrix.fill_zero();
        normal.add_to(structure, lambda, &mut self.matrix);
        let mut rhs = normal.right_hand_side();
        subtract_points(structure, linearization, damped, &mut self.matrix, &mut rhs, observer).await;
        if observer.should_stop() {
            return None;
        }
        normal.clear_removed(&mut rhs);
        self.matrix.remove_unknowns(&normal.removed);
        if let Kind::Cholesky(cholesky) = &mut self.kind {
            return cholesky.solve(&self.matrix, &rhs, observer).await.ok().map(|x| (x, 1));
        }
        let jacobi = BlockJacobi::new(&self.matrix);
        let coarse = self.second_level.at(structure, linearization, normal, damped, centers, lambda);
        let precondition = |r: &[f64], z: &mut [f64]| {
            jacobi.apply(r, z);
            if let Some(coarse) = coarse {
                coarse.add_to(&structure.layout, r, z);
            }
        };
        let result = if matches!(self.kind, Kind::PcgExplicit) {
            pcg(&mut Explicit(&self.matrix), precondition, &rhs, &self.pcg, observer).await
        } else {
            let mut operator = ImplicitOperator {
                structure,
                linearization,
                damped,
                normal,
                diagonal: normal.added_diagonal(lambda),
                lambda,
                projected: vec![[T::ZERO; ROWS]; structure.image.len()],
            };
            pcg(&mut operator, precondition, &rhs, &self.pcg, observer).await
        };
        self.second_level.took(result.iterations, self.pcg.max_iterations);
        Some((result.x, result.iterations))
    }
}

struct Explicit<'a>(&'a BlockMatrix);

impl LinearOperator for Explicit<'_> {
    fn apply(&mut self, x: &[f64], out: &mut [f64]) -> f64 {
        self.0.multiply(x, out);
        x.iter().zip(out.iter()).map(|(a, b)| a * b).sum()
    }
}
