//! Scenes for dynamic parameter extraction: points that start where no camera sees them, and observations that are hidden
//! and revealed while solving; with one measure for every way of solving them.

#![allow(dead_code, unreachable_pub)]

use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{Options, Problem};
use epipole_optimize::lm::{Evaluation, LmOptions, LmReport, Observer, Step, System, Trial};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{Scene, gauss3, perturb, ring};

/// Share of the points that start out of sight, and of the observations that are hidden at a time.
pub const SHARE: f64 = 0.3;
/// Residuals beyond this do not count as registered, px: where the dynamic limit ends.
const REGISTERED_PX: f64 = 4.0;

/// Tracks within a third of the ring, so that a point can be behind all of its cameras.
pub fn clean() -> Problem {
    ring(&Scene { images: 24, points: 600, track: 6, band: 8, ..Scene::default() })
}

/// The clean scene with poses and points moved, and 30 % of the points behind cameras, beside frusta or next to a centre.
pub fn out_of_sight() -> Problem {
    let mut problem = clean();
    perturb(&mut problem, 1.0, 0.05, 3);
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    for p in 0..problem.points.len() {
        if rng.random::<f64>() >= SHARE {
            continue;
        }
        let track = problem.track_start[p] as usize..problem.track_start[p + 1] as usize;
        let centers = problem.observation_image[track.clone()].iter();
        let centers: Vec<DVec3> = centers.map(|&i| problem.cam_from_world[i as usize].center()).collect();
        let mean = centers.iter().sum::<DVec3>() / centers.len() as f64;
        problem.points[p] = match p % 3 {
            // Behind all of them, far to the side of all of them, and next to the centre of one.
            0 => mean * 3.0 + gauss3(&mut rng),
            1 => problem.points[p] + DVec3::Y * 40.0,
            _ => centers[0] * 0.99,
        };
    }
    problem
}

/// The clean scene from a start some hundred pixels off, for [`Scripted`].
pub fn far_off() -> Problem {
    let mut problem = clean();
    perturb(&mut problem, 4.0, 0.15, 5);
    problem.cameras[0].params[0] *= 1.1;
    problem
}

/// Which observations a script hides after so many accepted steps: 30 % at a time, others every two steps, none from the
/// ninth on.
pub fn hides(step: usize, image: usize, point: usize) -> bool {
    let mixed = (image as u64 * 0x9e37_79b9 + point as u64 * 0x85eb_ca6b + (step / 2) as u64 * 0xc2b2_ae35) as f64;
    step < 9 && (mixed * 0.618_033_988_75).fract() < SHARE
}

/// A system that is told what is hidden before every look at its observations, and whether F rose in between.
pub struct Scripted<S, F> {
    pub inner: S,
    pub script: F,
    pub steps: usize,
    /// F after the last look, with what was hidden then.
    pub last: f64,
    /// Largest relative rise of F from one look to the next, both with the same observations hidden.
    pub worst_rise: f64,
}

impl<S: System, F: FnMut(&mut S, usize)> Scripted<S, F> {
    pub fn new(inner: S, script: F) -> Self {
        Self { inner, script, steps: 0, last: f64::INFINITY, worst_rise: 0.0 }
    }
}

impl<S: System, F: FnMut(&mut S, usize)> System for Scripted<S, F> {
    async fn refresh(&mut self, observer: &mut dyn Observer) -> Evaluation {
        if self.steps > 0 {
            let same = self.inner.refresh(observer).await;
            self.worst_rise = self.worst_rise.max(same.cost / self.last - 1.0);
        }
        (self.script)(&mut self.inner, self.steps);
        self.steps += 1;
        let now = self.inner.refresh(observer).await;
        self.last = now.cost;
        now
    }
    async fn linearize(&mut self, observer: &mut dyn Observer) {
        self.inner.linearize(observer).await;
    }
    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Option<Step> {
        self.inner.solve(lambda, observer).await
    }
    async fn try_step(&mut self) -> Trial {
        self.inner.try_step().await
    }
    async fn accept(&mut self) {
        self.inner.accept().await;
    }
    async fn reject(&mut self) {
        self.inner.reject().await;
    }
}

/// To the bottom: what is measured is where a solve ends.
pub fn options(activation: Activation, tolerance: f64) -> Options {
    let lm = LmOptions { max_iterations: 100, relative_decrease_tolerance: tolerance, ..LmOptions::default() };
    Options { lm, activation, ..Options::default() }
}

/// What a solve reached, measured alike whatever it counted itself.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// `½ Σ min(ρ, ρ(4 px))` over all observations.
    pub cost: f64,
    /// Points with at least two observations, and at least half of them, within 4 px.
    pub registered: usize,
    /// Largest error of a relative pose of neighbours on the ring: rotation, and direction of translation, degrees.
    pub worst_pose_deg: f64,
}

/// Measures a state.
pub fn measure(problem: &Problem, truth: &Problem) -> Outcome {
    let limit = problem.loss.value(REGISTERED_PX * REGISTERED_PX);
    let (mut cost, mut registered) = (0.0, 0);
    for (p, track) in problem.track_start.windows(2).enumerate() {
        let mut within = 0;
        for o in track[0] as usize..track[1] as usize {
            let image = problem.observation_image[o] as usize;
            let camera = &problem.cameras[problem.image_camera[image] as usize];
            let q = problem.cam_from_world[image].transform_point(problem.points[p]);
            let pixel = if q.z > 0.0 { camera.project(q) } else { None };
            let square = pixel.map_or(f64::INFINITY, |px| px.distance_squared(problem.observation_px[o]));
            within += u32::from(square < REGISTERED_PX * REGISTERED_PX);
            cost += 0.5 * problem.loss.value(square).min(limit);
        }
        registered += usize::from(within >= 2 && 2 * within >= track[1] - track[0]);
    }
    let mut worst_pose_deg: f64 = 0.0;
    for i in 0..problem.cam_from_world.len() {
        let j = (i + 1) % problem.cam_from_world.len();
        let relative = |p: &Problem| {
            let (a, b) = (&p.cam_from_world[i], &p.cam_from_world[j]);
            (b.rotation * a.rotation.inverse(), a.rotation * (b.center() - a.center()).normalize_or_zero())
        };
        let (found, wanted) = (relative(problem), relative(truth));
        let turn = (found.0 * wanted.0.inverse()).normalize();
        let angle = 2.0 * turn.xyz().length().min(1.0).asin();
        let direction = found.1.angle_between(wanted.1);
        worst_pose_deg = worst_pose_deg.max(angle.to_degrees()).max(direction.to_degrees());
    }
    Outcome { cost, registered, worst_pose_deg }
}

/// Asserts that F never rose, up to rounding.
pub fn assert_monotone(report: &LmReport, slack: f64) {
    let mut last = report.initial_cost;
    for record in &report.history {
        assert!(record.cost <= last * (1.0 + slack), "the objective rose from {last}: {record:?}");
        last = record.cost;
    }
}
