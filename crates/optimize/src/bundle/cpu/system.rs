//! The bundle problem resident on the CPU.

use epipole_geometry::camera::{MAX_PARAMS, Real};

use super::PIXELS;
use super::back_substitution::back_substitute;
use super::camera_step::CameraStep;
use super::depth_limits::DepthLimits;
use super::elimination::{DampedPoint, damp_points};
use super::linearization::Linearization;
use super::normal::CameraNormal;
use super::reduced_solver::ReducedSolver;
use super::revive::{Revival, Whom};
use super::rows::Losses;
use super::small::Vec3;
use super::state::{Cameras, Lattice, Points};
use super::structure::Structure;
use super::trial::{Move, evaluate, try_move};
use crate::active::ActiveSet;
use crate::bundle::frustum::Frusta;
use crate::bundle::options::Options;
use crate::bundle::problem::{ParamPrior, Problem};
use crate::error::OptimizeError;
use crate::executor::block_on;
use crate::extraction::Progress;
use crate::lm::{Evaluation, Observer, Places, Step, System, Trial, breath};

/// Accepted steps between two evaluations of the residuals from scratch, where they are carried as differences
/// (source: `solver.md` §5.5).
const RESIDUAL_REFRESH: usize = 10;

/// Least curvature along a residual relative to that across it, where a step gained so little that it left the residuals
/// where they were: only then does their curvature along themselves hold for the next step as well. Further away weights
/// alone converge faster and surer. The tail then falls by 4 an iteration
/// instead of 2.5 (bonsai292, Huber 1 px); at 0.35 some steps overshoot and are refused, at 0.1 most.
const RADIAL_FLOOR: f64 = 0.5;

/// A bundle adjustment problem on the CPU, in `f32` or `f64`. The reduced system is always in `f64`. Observations have
/// [`PIXELS`] rows, or [`WITH_DEPTH`](super::WITH_DEPTH): what has no depth at all pays nothing for the feature.
#[derive(Debug)]
pub struct CpuSystem<T: Real, const ROWS: usize = PIXELS> {
    structure: Structure,
    lattice: Lattice,
    losses: Losses,
    /// See [`Losses::offset`].
    offset: f64,
    priors: Vec<Vec<ParamPrior>>,
    depths: DepthLimits,
    active: ActiveSet,
    cameras: Cameras<T>,
    points: Points<T>,
    /// Residuals at the accepted state, NaN where there is no valid projection.
    residual: Vec<[T; ROWS]>,
    next_cameras: Option<Cameras<T>>,
    next_points: Vec<Vec3<T>>,
    next_residual: Vec<[T; ROWS]>,
    linearization: Linearization<T, ROWS>,
    /// `None`: the next solve linearises first.
    normal: Option<CameraNormal>,
    damped: Vec<DampedPoint>,
    solver: ReducedSolver,
    accepted: usize,
    /// 1, or [`RADIAL_FLOOR`].
    radial_floor: f64,
    progress: Progress,
    /// A refused step: the model promises too much, stay with weights alone.
    refused: bool,
    camera_step: Vec<f64>,
}

impl<T: Real, const ROWS: usize> CpuSystem<T, ROWS> {
    /// Checks a problem and makes it resident.
    pub fn new(problem: &Problem, options: &Options) -> Result<Self, OptimizeError> {
        block_on(Self::prepare(problem, options, &mut ()))
    }

    /// [`Self::new`] for a host that may not block.
    pub(in crate::bundle) async fn prepare(
        problem: &Problem,
        options: &Options,
        observer: &mut dyn Observer,
    ) -> Result<Self, OptimizeError> {
        problem.validate()?;
        let structure = Structure::new(problem);
        breath(observer).await;
        let solver = ReducedSolver::new(&structure, options)?;
        breath(observer).await;
        let lattice = Lattice::new::<T>(problem, &structure);
        let cameras = Cameras::new(problem, &lattice);
        let points = Points::new(problem, &lattice);
        let depths = DepthLimits::new(problem, options.activation);
        let observations = structure.image.len();
        let mut residual = vec![[T::ZERO; ROWS]; observations];
        evaluate(&structure, &lattice, &cameras, &points, &depths, &mut residual);
        let losses = Losses::new(problem);
        Ok(Self {
            losses,
            offset: if ROWS == PIXELS { 0.0 } else { losses.offset(&structure) },
            priors: problem.param_priors.clone(),
            depths,
            active: ActiveSet::new(options.activation, problem.loss, observations),
            next_cameras: None,
            next_points: points.offset.clone(),
            next_residual: residual.clone(),
            linearization: Linearization::new(&structure),
            normal: None,
            damped: Vec::new(),
            solver,
            accepted: 0,
            radial_floor: 1.0,
            progress: Progress::START,
            refused: false,
            camera_step: Vec::new(),
            structure,
            lattice,
            cameras,
            points,
            residual,
        })
    }

    /// Writes the accepted state back, and returns its cost evaluated from the written values in `f64`.
    pub fn write(&self, problem: &mut Problem) -> f64 {
        self.cameras.write(problem, &self.structure);
        self.points.write(problem, &self.structure, &self.lattice);
        let lattice = Lattice { cell: 0.0 };
        let cameras = Cameras::<f64>::new(problem, &lattice);
        let points = Points::<f64>::new(problem, &lattice);
        let mut residual = vec![[0.0; ROWS]; self.structure.image.len()];
        evaluate(&self.structure, &lattice, &cameras, &points, &self.depths, &mut residual);
        let rho = |o: usize| self.losses.value(&self.structure, o, &residual[o]);
        self.active.cost(rho) + self.offset + prior_cost(&self.priors, &cameras.params, &self.structure)
    }

    /// Says which images do not see which points for the time being, whatever the geometry says: `hides(image, point)`,
    /// in force from the next refresh.
    pub fn occlude(&mut self, hides: impl Fn(usize, usize) -> bool) {
        let pairs = self.structure.image.iter().zip(&self.structure.point);
        self.active.occlude(pairs.map(|(&i, &p)| hides(i as usize, p as usize)).collect());
    }

    /// Decides the set at the accepted state, and gives the cost of the observations.
    fn decide(&mut self) -> f64 {
        let (residual, before) = (&self.residual, &self.next_residual);
        let (losses, structure, frusta) = (self.losses, &self.structure, &self.depths.frusta);
        self.active.update(
            |o| losses.value(structure, o, &residual[o]),
            |o| losses.value(structure, o, &before[o]),
            |o| enters(structure, frusta, residual, o),
        )
    }

    /// The part of dynamic extraction that moves points and the limit, before the set is decided. Lowers F or leaves it.
    fn extract(&mut self) {
        let (structure, frusta, residual) = (&self.structure, &self.depths.frusta, &self.residual);
        self.active.lower_limit(|o| square(&residual[o]), |o| enters(structure, frusta, residual, o));
        if !self.active.has_started() {
            self.decide();
        }
        let revival =
            Revival::new(&self.structure, &self.lattice, &self.cameras, &self.depths, &self.active, self.losses);
        let whom = if self.progress.is_time_for_all() { Whom::Incomplete } else { Whom::Poor };
        revival.run(whom, &mut self.points, &mut self.residual);
    }

    fn prior_cost(&self, cameras: &Cameras<T>) -> f64 {
        prior_cost(&self.priors, &cameras.params, &self.structure)
    }
}

fn square<T: Real, const ROWS: usize>(residual: &[T; ROWS]) -> f64 {
    (residual[0] * residual[0] + residual[1] * residual[1]).to_f64()
}

/// Whether an observation's projection lies inside its frustum.
fn enters<T: Real, const ROWS: usize>(
    structure: &Structure,
    frusta: &Frusta,
    residual: &[[T; ROWS]],
    o: usize,
) -> bool {
    let px = std::array::from_fn(|k| structure.px[o][k] + residual[o][k].to_f64());
    frusta.contains(structure.image[o] as usize, px)
}

/// `½ Σ ((p − mean)/σ)²` over priors on parameters that may move.
fn prior_cost(priors: &[Vec<ParamPrior>], params: &[[f64; MAX_PARAMS]], structure: &Structure) -> f64 {
    let terms = priors.iter().zip(params).zip(&structure.free_params);
    terms
        .flat_map(|((priors, params), free)| {
            let moves = move |p: &&ParamPrior| free.iter().any(|&f| f as usize == p.index);
            priors.iter().filter(moves).map(|p| 0.5 * ((params[p.index] - p.mean) / p.sigma).powi(2))
        })
        .sum()
}

impl<T: Real, const ROWS: usize> System for CpuSystem<T, ROWS> {
    async fn refresh(&mut self, _: &mut dyn Observer) -> Evaluation {
        if self.active.is_dynamic() {
            self.extract();
        }
        let cost = self.decide() + self.offset + self.prior_cost(&self.cameras);
        let near = self.progress.note(cost);
        self.radial_floor = if near && !self.refused { RADIAL_FLOOR } else { 1.0 };
        Evaluation { cost, active: self.active.count() }
    }

    async fn linearize(&mut self, observer: &mut dyn Observer) {
        let update = self.linearization.update(
            &self.structure,
            &self.lattice,
            &self.cameras,
            &self.points,
            &self.residual,
            &self.active,
            self.losses,
            self.radial_floor,
            self.depths.side,
            observer,
        );
        update.await;
        let (structure, params) = (&self.structure, &self.cameras.params);
        self.normal = Some(CameraNormal::new(structure, &self.linearization, &self.priors, params, observer).await);
    }

    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Option<Step> {
        if self.normal.is_none() {
            self.linearize(observer).await;
        }
        let normal = self.normal.as_ref()?;
        let (structure, linearization) = (&self.structure, &self.linearization);
        damp_points(linearization, lambda, &mut self.damped);
        let damped = &self.damped;
        let (x, inner_iterations) = if normal.is_empty() {
            (vec![0.0; structure.layout.dim()], 0)
        } else {
            let centers = &self.cameras.center;
            self.solver.solve(structure, linearization, normal, damped, centers, lambda, observer).await?
        };
        breath(observer).await;
        let step = CameraStep::new(structure, &x);
        let promise =
            back_substitute(structure, linearization, damped, &step, &self.points.offset, &mut self.next_points);
        let scaled = x.iter().zip(&normal.diagonal).map(|(x, d)| x.abs() * d.sqrt()).fold(0.0, f64::max);
        self.next_cameras = Some(self.cameras.stepped(structure, &self.lattice, &x));
        let predicted_decrease = promise.decrease + normal.prior_decrease(&x);
        self.camera_step = x;
        Some(Step { predicted_decrease, inner_iterations, max_scaled_step: promise.max_scaled_step.max(scaled) })
    }

    async fn try_step(&mut self) -> Trial {
        let Some(next_cameras) = &self.next_cameras else { return Trial { decrease: f64::NAN } };
        let state = Move { cameras: &self.cameras, next_cameras, points: &self.points, next_points: &self.next_points };
        let decrease = try_move(
            &self.structure,
            &self.lattice,
            &state,
            &self.active,
            self.losses,
            &self.depths,
            &self.residual,
            &mut self.next_residual,
        );
        let priors = self.prior_cost(&self.cameras) - self.prior_cost(next_cameras);
        Trial { decrease: decrease + priors }
    }

    async fn accept(&mut self) {
        let Some(next_cameras) = self.next_cameras.take() else { return };
        self.cameras = next_cameras;
        std::mem::swap(&mut self.points.offset, &mut self.next_points);
        std::mem::swap(&mut self.residual, &mut self.next_residual);
        self.accepted += 1;
        if self.lattice.cell != 0.0 {
            self.points.recell(&self.lattice);
            if self.accepted.is_multiple_of(RESIDUAL_REFRESH) {
                let (cameras, points) = (&self.cameras, &self.points);
                evaluate(&self.structure, &self.lattice, cameras, points, &self.depths, &mut self.residual);
            }
        }
    }

    async fn reject(&mut self) {
        self.next_cameras = None;
        self.refused = true;
        if self.radial_floor < 1.0 && !self.losses.is_squared() {
            // Not the damping but the curvature was too small: weights alone give a good step at once.
            self.radial_floor = 1.0;
            self.normal = None;
        }
    }

    async fn places(&mut self) -> Option<Places> {
        let points = 0..self.points.offset.len();
        Some(Places {
            centers: (0..).zip(self.cameras.center.iter().copied()).collect(),
            points: (0..).zip(points.map(|p| self.points.position(p, &self.lattice))).collect(),
        })
    }
}
