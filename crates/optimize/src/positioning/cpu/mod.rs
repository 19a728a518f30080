//! Positioning on the CPU, in either precision.

mod system;

use epipole_geometry::camera::Real;

use super::backend::{Backend, ConvexStep, Objective};
use super::block::{Block, deviation, held};
use super::convex::linearize;
use super::gauge::Positions;
use super::layout::{Layout, Rays};
use super::normal::{LinearSolver, Normal, Shape};
use super::options::Options;
use super::vec3::{add, sub};
use crate::error::OptimizeError;
use crate::lm::{self, LmReport, Observer, breath};
use crate::loss::Loss;
use system::System;

/// Positions and, during a convex start, what its solves need.
pub(crate) struct Cpu<'a, T> {
    layout: &'a Layout,
    rays: &'a Rays<T>,
    solver: LinearSolver,
    positions: Positions<T>,
    convex: Option<Convex<T>>,
}

struct Convex<T> {
    objective: Objective,
    normal: Normal<T>,
    blocks: Vec<Block<T>>,
}

impl<'a, T: Real> Cpu<'a, T> {
    /// Everything in the origin.
    pub(crate) fn new(layout: &'a Layout, rays: &'a Rays<T>, solver: LinearSolver) -> Self {
        Self { layout, rays, solver, positions: Positions::origin(layout), convex: None }
    }
}

impl<T: Real> Convex<T> {
    /// Takes the positions over, and returns the objective there.
    async fn linearize(
        &mut self,
        layout: &Layout,
        rays: &Rays<T>,
        positions: &Positions<T>,
        observer: &mut dyn Observer,
    ) -> f64 {
        let sum = match self.objective {
            Objective::EqualScales { free_scale, huber } => {
                let (free_scale, loss) = (T::from_f64(free_scale), Loss::Huber(huber));
                let doubled = linearize(layout, positions, &mut self.blocks, observer, |o, d| {
                    let s = if rays.pin[o] > T::ZERO { rays.pin[o] } else { free_scale };
                    held(rays.direction[o], rays.weight[o], s, d, loss)
                });
                0.5 * doubled.await
            }
            Objective::Lud { bound, delta } => {
                let (bound, delta) = (T::from_f64(bound), T::from_f64(delta));
                let sum = linearize(layout, positions, &mut self.blocks, observer, |o, d| {
                    deviation(rays.direction[o], rays.weight[o], rays.pin[o], d, bound, delta)
                });
                sum.await
            }
        };
        self.normal.gather(layout, &self.blocks, observer).await;
        sum
    }
}

impl<T: Real> Backend for Cpu<'_, T> {
    type Scalar = T;

    async fn begin(&mut self, objective: Objective, observer: &mut dyn Observer) -> Result<f64, OptimizeError> {
        let shape = match objective {
            Objective::EqualScales { .. } => Shape::Isotropic,
            Objective::Lud { .. } => Shape::Full,
        };
        if matches!(objective, Objective::EqualScales { .. }) {
            self.positions = Positions::origin(self.layout);
        }
        let normal = Normal::new(self.layout, shape, self.solver, observer).await;
        let normal =
            normal.ok_or(OptimizeError::OutOfMemory { what: "the linear system of a convex start of positioning" })?;
        let blocks = vec![Block::masked(); self.layout.observations()];
        let convex = self.convex.insert(Convex { objective, normal, blocks });
        Ok(convex.linearize(self.layout, self.rays, &self.positions, observer).await)
    }

    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<Option<ConvexStep>, OptimizeError> {
        let Some(convex) = &mut self.convex else { return Ok(None) };
        let solved = convex.normal.solve(self.layout, &convex.blocks, lambda, observer).await;
        let Some(step) = solved else { return Ok(None) };
        let positions = &mut self.positions;
        let mut moved = 0.0f64;
        for (center, delta) in positions.centers.iter_mut().zip(&step.centers) {
            let next = add(*center, *delta);
            moved = moved.max(largest(sub(*center, next)));
            *center = next;
        }
        for (point, delta) in positions.points.iter_mut().zip(&step.points) {
            *point = add(*point, *delta);
        }
        let extent = positions.centers.iter().map(|&center| largest(center)).fold(0.0, f64::max);
        let cost = convex.linearize(self.layout, self.rays, positions, observer).await;
        Ok(Some(ConvexStep { cost, inner_iterations: step.inner_iterations, moved, extent }))
    }

    async fn project(
        &mut self,
        rays: &Rays<T>,
        options: &Options,
        observer: &mut dyn Observer,
    ) -> Result<LmReport, OptimizeError> {
        self.convex = None;
        let mut system = System::new(self.layout, rays, self.positions.clone(), options, observer).await?;
        breath(observer).await;
        let report = lm::minimize(&mut system, &options.lm, observer).await;
        self.positions = system.into_positions();
        Ok(report)
    }

    async fn positions(&mut self) -> Result<Positions<T>, OptimizeError> {
        Ok(self.positions.clone())
    }

    fn place(&mut self, positions: &Positions<T>) {
        self.positions = positions.clone();
    }
}

fn largest<T: Real>(v: [T; 3]) -> f64 {
    v.into_iter().fold(0.0, |a, v| a.max(v.abs().to_f64()))
}
