//! Variable projection on the CPU: the system that the Levenberg–Marquardt loop drives.

use epipole_geometry::camera::Real;

use crate::error::OptimizeError;
use crate::lm;
use crate::loss::Loss;
use crate::parallel;
use crate::positioning::block::{Block, Model};
use crate::positioning::convex::linearize;
use crate::positioning::gauge::Positions;
use crate::positioning::layout::{Layout, Rays};
use crate::positioning::normal::{self, Normal, Shape};
use crate::positioning::options::Options;
use crate::positioning::triangle::Triangle;
use crate::positioning::vec3::{Vec3, add, dot, scale, sub, zero};

/// Centres and points as unknowns, every free scale re-solved exactly at every state (`reference/solver.md` §3.2).
///
/// The cost is `½ Σ ω ρ(‖v − s d‖²)` over all observations, those behind their camera included at their bound, so it
/// never rises from one accepted state to the next.
pub(crate) struct System<'a, T> {
    layout: &'a Layout,
    rays: &'a Rays<T>,
    model: Model<T>,
    normal: Normal<T>,
    accepted: Positions<T>,
    trial: Positions<T>,
    blocks: Vec<Block<T>>,
    step: Option<normal::Step<T>>,
    evaluation: lm::Evaluation,
    trial_evaluation: lm::Evaluation,
    point_cost: Vec<f64>,
    trial_point_cost: Vec<f64>,
}

impl<'a, T: Real> System<'a, T> {
    /// Starts from the given positions, centred and, without pins, rescaled to a median distance of 1.
    ///
    /// # Errors
    /// [`OptimizeError::OutOfMemory`] when the pattern of the linear system does not fit.
    pub(crate) async fn new(
        layout: &'a Layout,
        rays: &'a Rays<T>,
        mut start: Positions<T>,
        options: &Options,
        observer: &mut dyn lm::Observer,
    ) -> Result<Self, OptimizeError> {
        start.normalize(layout, rays);
        let min_scale = options.min_scale * start.median_scale(layout, rays);
        let model = Model {
            free_loss: Loss::Huber(options.huber),
            pinned_loss: Loss::Huber(options.huber_pinned),
            min_scale: T::from_f64(min_scale),
        };
        lm::breath(observer).await;
        let normal = Normal::new(layout, Shape::Full, options.linear_solver, observer).await;
        let normal = normal.ok_or(OptimizeError::OutOfMemory { what: "the linear system of positioning" })?;
        let (point_cost, evaluation) = evaluate(layout, rays, &model, &start);
        Ok(Self {
            layout,
            rays,
            model,
            normal,
            trial: start.clone(),
            accepted: start,
            blocks: vec![Block::masked(); layout.observations()],
            step: None,
            evaluation,
            trial_evaluation: evaluation,
            trial_point_cost: point_cost.clone(),
            point_cost,
        })
    }

    /// The last accepted state.
    pub(crate) fn into_positions(self) -> Positions<T> {
        self.accepted
    }
}

impl<T: Real> lm::System for System<'_, T> {
    async fn refresh(&mut self, _: &mut dyn lm::Observer) -> lm::Evaluation {
        self.evaluation
    }

    async fn linearize(&mut self, observer: &mut dyn lm::Observer) {
        let (rays, model) = (self.rays, &self.model);
        let linearized = linearize(self.layout, &self.accepted, &mut self.blocks, observer, |o, d| {
            model.linearize(rays.direction[o], rays.weight[o], rays.pin[o], d)
        });
        linearized.await;
        self.normal.gather(self.layout, &self.blocks, observer).await;
    }

    async fn solve(&mut self, lambda: f64, observer: &mut dyn lm::Observer) -> Option<lm::Step> {
        self.step = self.normal.solve(self.layout, &self.blocks, lambda, observer).await;
        self.step.as_ref().map(|step| lm::Step {
            predicted_decrease: step.predicted_decrease,
            inner_iterations: step.inner_iterations.max(1),
            max_scaled_step: self.normal.max_scaled_step(step),
        })
    }

    async fn try_step(&mut self) -> lm::Trial {
        let Some(step) = &self.step else { return lm::Trial { decrease: f64::NAN } };
        let centers = self.accepted.centers.iter().zip(&step.centers);
        self.trial.centers = centers.map(|(center, step)| add(*center, *step)).collect();
        let problem = Tracks { layout: self.layout, rays: self.rays, model: &self.model, centers: &self.trial.centers };
        let sizes = self.layout.point_offsets();
        let points = parallel::split_mut(&mut self.trial.points, &sizes);
        let costs = parallel::split_mut(&mut self.trial_point_cost, &sizes);
        let mut work: Vec<_> = points.into_iter().zip(costs).map(|(points, costs)| (points, costs, 0)).collect();
        let (accepted, accepted_cost) = (&self.accepted.points, &self.point_cost);
        parallel::for_each_mut(&mut work, |chunk, (points, costs, active)| {
            for (k, point) in self.layout.chunks[chunk].clone().enumerate() {
                let (position, value) =
                    problem.best_point(point, accepted[point], step.points[point], accepted_cost[point]);
                points[k] = position;
                costs[k] = value.cost;
                *active += value.active;
            }
        });
        let active = work.iter().map(|(_, _, active)| active).sum();
        self.trial_evaluation = lm::Evaluation { cost: self.trial_point_cost.iter().sum(), active };
        lm::Trial { decrease: self.evaluation.cost - self.trial_evaluation.cost }
    }

    async fn accept(&mut self) {
        std::mem::swap(&mut self.accepted, &mut self.trial);
        std::mem::swap(&mut self.point_cost, &mut self.trial_point_cost);
        self.evaluation = self.trial_evaluation;
        // The cost does not see the gauge, provided that the bound moves with it.
        let factor = self.accepted.normalize(self.layout, self.rays);
        self.model.min_scale = T::from_f64(self.model.min_scale.to_f64() / factor);
    }

    async fn reject(&mut self) {
        self.step = None;
    }

    async fn places(&mut self) -> Option<lm::Places> {
        Some(self.accepted.places(self.layout))
    }
}

/// What a point's observations cost, given the centres: the cost of the whole is the sum of these.
struct Tracks<'a, T> {
    layout: &'a Layout,
    rays: &'a Rays<T>,
    model: &'a Model<T>,
    centers: &'a [Vec3<T>],
}

impl<T: Real> Tracks<'_, T> {
    /// Cost of a point at a position, and how many observations pull at it: all but those at the bound.
    fn cost(&self, point: usize, position: Vec3<T>) -> lm::Evaluation {
        let (mut cost, mut active) = (0.0, 0);
        for o in self.layout.track(point) {
            let d = sub(position, self.centers[self.layout.camera[o] as usize]);
            let (rho, pulls) = self.model.cost(self.rays.direction[o], self.rays.weight[o], self.rays.pin[o], d);
            cost += 0.5 * rho.to_f64();
            active += usize::from(pulls && self.rays.weight[o] > T::ZERO);
        }
        lm::Evaluation { cost, active }
    }

    /// Where the point goes: by its step, or, where the step makes the point itself worse (the model of a far point is
    /// poor, and one such point could have a good step of all cameras refused), by half of it, not at all, or to where
    /// its rays meet; whichever costs least.
    fn best_point(
        &self,
        point: usize,
        position: Vec3<T>,
        step: Vec3<T>,
        accepted_cost: f64,
    ) -> (Vec3<T>, lm::Evaluation) {
        let stepped = add(position, step);
        let mut best = (stepped, self.cost(point, stepped));
        if best.1.cost <= accepted_cost {
            return best;
        }
        let half = add(position, scale(step, T::from_f64(0.5)));
        for candidate in [Some(half), Some(position), self.meeting_point(point, position)].into_iter().flatten() {
            let value = self.cost(point, candidate);
            // A NaN cost must lose, also when it came first.
            if value.cost < best.1.cost || best.1.cost.is_nan() {
                best = (candidate, value);
            }
        }
        best
    }

    /// Least squares of the rays' distances over their lengths.
    fn meeting_point(&self, point: usize, position: Vec3<T>) -> Option<Vec3<T>> {
        let mut triangle = Triangle::zero();
        let mut right = zero();
        for o in self.layout.track(point) {
            let center = self.centers[self.layout.camera[o] as usize];
            let d = sub(position, center);
            let block = Block {
                direction: self.rays.direction[o],
                scale: (self.rays.weight[o] / dot(d, d)).sqrt(),
                gradient: zero(),
            };
            block.fold_into(&mut triangle);
            right = add(right, block.apply(center));
        }
        let inverse = triangle.inverse();
        let meeting = inverse.apply(inverse.apply_transpose(right));
        (inverse != Triangle::zero() && meeting.iter().all(|x| x.is_finite())).then_some(meeting)
    }
}

/// Cost of every point.
fn evaluate<T: Real>(
    layout: &Layout,
    rays: &Rays<T>,
    model: &Model<T>,
    positions: &Positions<T>,
) -> (Vec<f64>, lm::Evaluation) {
    let tracks = Tracks { layout, rays, model, centers: &positions.centers };
    let values = parallel::map_indices(layout.chunks.len(), |chunk| {
        layout.chunks[chunk].clone().map(|point| tracks.cost(point, positions.points[point])).collect::<Vec<_>>()
    })
    .concat();
    let active = values.iter().map(|value| value.active).sum();
    let costs: Vec<f64> = values.into_iter().map(|value| value.cost).collect();
    let cost = costs.iter().sum();
    (costs, lm::Evaluation { cost, active })
}
