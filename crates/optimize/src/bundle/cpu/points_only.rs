//! Points alone, poses and intrinsics constant: each point is a problem of three unknowns with its own damping.

use super::depth_limits::DepthLimits;
use super::linearization::PointGroups;
use super::point_block::{column_norms_squared, damp, fold_row, has_full_rank, solve_normal};
use super::revive::{Revival, Whom};
use super::rows::{Losses, depth_row};
use super::small::{Vec3, add, rotate, row_times, sub};
use super::state::{Cameras, Lattice, Points};
use super::structure::Structure;
use super::trial::{evaluate, residual};
use super::{PIXELS, WITH_DEPTH};
use crate::active::{Activation, ActiveSet};
use crate::bundle::options::Options;
use crate::bundle::problem::Problem;
use crate::lm::{IterationRecord, LmOptions, LmReport, Observer, Termination};
use crate::parallel;

struct Context<'a> {
    structure: &'a Structure,
    cameras: &'a Cameras<f64>,
    depths: &'a DepthLimits,
    losses: Losses,
    activation: Activation,
    lm: &'a LmOptions,
}

/// What became of one point.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    position: Vec3<f64>,
    initial_cost: f64,
    final_cost: f64,
    iterations: usize,
    accepted: usize,
    active: usize,
}

/// Where the points begin.
struct Start {
    points: Points<f64>,
    /// What holds for each point alone: a dynamic limit is one for all, and fixed once points are triangulated again.
    activation: Activation,
    /// The cost before points were triangulated again.
    cost: Option<f64>,
}

fn start(
    problem: &Problem,
    activation: Activation,
    structure: &Structure,
    cameras: &Cameras<f64>,
    depths: &DepthLimits,
) -> Start {
    let (lattice, losses) = (Lattice { cell: 0.0 }, Losses::new(problem));
    let mut points = Points::<f64>::new(problem, &lattice);
    let mut set = ActiveSet::new(activation, losses.pixel, structure.image.len());
    if !set.is_dynamic() {
        return Start { points, activation, cost: None };
    }
    let mut residuals = vec![[0.0; WITH_DEPTH]; structure.image.len()];
    evaluate(structure, &lattice, cameras, &points, depths, &mut residuals);
    let square = |r: &[f64; WITH_DEPTH]| r[0] * r[0] + r[1] * r[1];
    let enters = |residuals: &[[f64; WITH_DEPTH]], o: usize| {
        let px = std::array::from_fn(|k| structure.px[o][k] + residuals[o][k]);
        depths.frusta.contains(structure.image[o] as usize, px)
    };
    let before = residuals.clone();
    set.lower_limit(|o| square(&residuals[o]), |o| enters(&residuals, o));
    Revival::new(structure, &lattice, cameras, depths, &set, losses).run(Whom::Incomplete, &mut points, &mut residuals);
    set.lower_limit(|o| square(&residuals[o]), |o| enters(&residuals, o));
    let residual_limit_px = set.limit_px();
    let rho = |o: usize| losses.value(structure, o, &before[o]);
    let cost = losses.offset(structure) + set.update(rho, |_| f64::NAN, |o| enters(&before, o));
    Start { points, activation: Activation::Truncated { residual_limit_px }, cost: Some(cost) }
}

/// Moves every point to the least cost it can reach. The problem must be valid.
pub(crate) fn solve_points(problem: &mut Problem, options: &Options, observer: &mut dyn Observer) -> LmReport {
    let structure = Structure::new(problem);
    let lattice = Lattice { cell: 0.0 };
    let cameras = Cameras::<f64>::new(problem, &lattice);
    let depths = DepthLimits::new(problem, options.activation);
    let start = start(problem, options.activation, &structure, &cameras, &depths);
    let context = Context {
        structure: &structure,
        cameras: &cameras,
        depths: &depths,
        losses: Losses::new(problem),
        activation: start.activation,
        lm: &options.lm,
    };
    let mut outcomes: Vec<Outcome> =
        start.points.offset.iter().map(|&position| Outcome { position, ..Outcome::default() }).collect();
    let groups = PointGroups::new(&structure);
    let mut pieces = parallel::split_mut(&mut outcomes, &groups.points);
    let stop = observer.should_stop();
    parallel::for_each_mut(&mut pieces, |g, outcomes| {
        for (outcome, p) in outcomes.iter_mut().zip(groups.points[g]..) {
            context.solve(p, outcome, stop);
        }
    });
    let sum = |f: fn(&Outcome) -> f64| outcomes.iter().map(f).sum::<f64>();
    let count = |f: fn(&Outcome) -> usize| outcomes.iter().map(f).sum::<usize>();
    let iterations = outcomes.iter().map(|o| o.iterations).max().unwrap_or(0);
    let (initial_cost, final_cost) = (start.cost.unwrap_or_else(|| sum(|o| o.initial_cost)), sum(|o| o.final_cost));
    let (accepted, active) = (count(|o| o.accepted), count(|o| o.active));
    for (position, outcome) in problem.points.iter_mut().zip(&outcomes) {
        *position = outcome.position.into();
    }
    let termination = match (stop, active == 0 || problem.fixed_points) {
        (true, _) => Termination::Stopped,
        (false, true) => Termination::NothingToSolve,
        (false, false) if iterations >= options.lm.max_iterations => Termination::MaxIterations,
        (false, false) => Termination::CostConverged,
    };
    let record = IterationRecord {
        iteration: iterations,
        cost: final_cost,
        lambda: options.lm.lambda0,
        gain: 0.0,
        inner_iterations: 0,
        active,
        accepted: accepted > 0,
    };
    observer.iteration(&record);
    LmReport {
        initial_cost,
        final_cost,
        iterations,
        accepted,
        rejected: count(|o| o.iterations) - accepted,
        inner_iterations: 0,
        active,
        termination,
        history: vec![record],
    }
}

impl Context<'_> {
    fn solve(&self, p: usize, outcome: &mut Outcome, stop: bool) {
        let track = self.structure.track(p);
        let mut set = ActiveSet::new(self.activation, self.losses.pixel, track.len());
        let mut residuals = self.residuals(p, &outcome.position);
        let rho = |k: usize, r: &[f64; WITH_DEPTH]| self.losses.value(self.structure, track.start + k, r);
        let offset = self.losses.track_offset(self.structure, track.clone());
        let enters = |residuals: &[[f64; WITH_DEPTH]], k: usize| {
            let o = track.start + k;
            let px = std::array::from_fn(|n| self.structure.px[o][n] + residuals[k][n]);
            self.depths.frusta.contains(self.structure.image[o] as usize, px)
        };
        let mut cost = offset + set.update(|k| rho(k, &residuals[k]), |_| f64::NAN, |k| enters(&residuals, k));
        (outcome.initial_cost, outcome.final_cost, outcome.active) = (cost, cost, set.count());
        if self.structure.fixed_points || stop {
            return;
        }
        let (mut lambda, mut factor, mut small) = (self.lm.lambda0, 2.0, 0);
        while outcome.iterations < self.lm.max_iterations && set.count() >= 2 {
            outcome.iterations += 1;
            let Some((step, predicted, scaled)) = self.step(p, &outcome.position, &residuals, &set, lambda) else {
                break;
            };
            if scaled < self.lm.scaled_step_tolerance {
                break;
            }
            let next = sub(&outcome.position, &step);
            let after = self.residuals(p, &next);
            let mut change = 0.0;
            for k in (0..track.len()).filter(|&k| set.is_active(k)) {
                // One point alone does not step behind a camera: NaN refuses the step.
                let delta = std::array::from_fn(|row| after[k][row] - residuals[k][row]);
                change += self.losses.difference(&residuals[k], &delta);
            }
            let gain = if predicted > 0.0 { -0.5 * change / predicted } else { 0.0 };
            if gain > self.lm.accept_gain && gain.is_finite() {
                outcome.accepted += 1;
                outcome.position = next;
                let before = cost;
                let set_cost = set.update(|k| rho(k, &after[k]), |k| rho(k, &residuals[k]), |k| enters(&after, k));
                cost = offset + set_cost;
                residuals = after;
                small = if -0.5 * change <= self.lm.relative_decrease_tolerance * before { small + 1 } else { 0 };
                lambda = (lambda * (1.0 - (2.0 * gain.min(1.5) - 1.0).powi(3)).max(1.0 / 3.0)).max(self.lm.lambda_min);
                factor = 2.0;
                if small >= 2 {
                    break;
                }
            } else {
                lambda *= factor;
                factor *= 2.0;
                if lambda > self.lm.lambda_max {
                    break;
                }
            }
        }
        (outcome.final_cost, outcome.active) = (cost, set.count());
    }

    fn camera_point(&self, o: usize, position: &Vec3<f64>) -> (usize, usize, Vec3<f64>) {
        let i = self.structure.image[o] as usize;
        let view = &self.cameras.views[i];
        (i, self.structure.camera[i] as usize, rotate(&view.rotation, &sub(position, &view.center)))
    }

    fn residuals(&self, p: usize, position: &Vec3<f64>) -> Vec<[f64; WITH_DEPTH]> {
        let one = |o: usize| {
            let (i, c, q) = self.camera_point(o, position);
            let params = &self.cameras.view_params[c];
            let (side, least) = (self.depths.side, self.depths.least(i));
            let (px, depth) = (self.structure.px[o], self.structure.depth(o));
            residual(side, self.structure.model[c], params, q, least, px, depth)
        };
        self.structure.track(p).map(one).collect()
    }

    /// What to subtract, the decrease it promises, and its size in units of the column scales.
    fn step(
        &self,
        p: usize,
        position: &Vec3<f64>,
        residuals: &[[f64; WITH_DEPTH]],
        set: &ActiveSet,
        lambda: f64,
    ) -> Option<(Vec3<f64>, f64, f64)> {
        let (mut triangle, mut gradient) = ([0.0; 6], [0.0; 3]);
        for (k, o) in self.structure.track(p).enumerate().filter(|(k, _)| set.is_active(*k)) {
            let (i, c, q) = self.camera_point(o, position);
            let view = &self.cameras.views[i];
            let projection =
                self.depths.side.differentiate(self.structure.model[c], &self.cameras.view_params[c], q)?;
            let r = residuals[k];
            let weight = self.losses.pixel.weight(r[0] * r[0] + r[1] * r[1]);
            for n in 0..PIXELS {
                let row = row_times(&projection.d_point[n], &view.rotation);
                gradient = add(&gradient, &row.map(|v| v * weight * r[n]));
                fold_row(&mut triangle, row.map(|v| v * weight.sqrt()));
            }
            let [_, depth_weight] = self.structure.depth(o);
            if depth_weight > 0.0 {
                let weight = self.losses.depth.weight(r[PIXELS] * r[PIXELS]);
                let row = depth_row(q[2], depth_weight, [view.rotation[6], view.rotation[7], view.rotation[8]]);
                gradient = add(&gradient, &row.map(|v| v * weight * r[PIXELS]));
                fold_row(&mut triangle, row.map(|v| v * weight.sqrt()));
            }
        }
        if !has_full_rank(&triangle) {
            return None;
        }
        let step = solve_normal(&damp(&triangle, lambda.sqrt()), &gradient);
        // The exact minimiser of the damped model: ½ gᵀδ + ½ λ δᵀDδ is what the undamped one promises.
        let scale = column_norms_squared(&triangle);
        let along: f64 = (0..3).map(|k| gradient[k] * step[k]).sum();
        let damping: f64 = (0..3).map(|k| lambda * scale[k] * step[k] * step[k]).sum();
        let scaled = (0..3).map(|k| scale[k].sqrt() * step[k].abs()).fold(0.0, f64::max);
        Some((step, 0.5 * (along + damping), scaled))
    }
}
