//! The whole solve: start, variable projection, signs of failure, retries, and the answer in the caller's arrays.

use epipole_geometry::camera::Real;
use glam::DVec3;

use super::backend::Backend;
use super::convex::{ConvexReport, equal_scales, lud, unit};
use super::cpu::Cpu;
use super::gauge::{Positions, median};
use super::layout::{Layout, Rays};
use super::options::Options;
use super::problem::Problem;
use super::quality::{Grade, angles, quality};
use super::report::{Attempt, Report, Start, Warning};
use super::vec3::to_dvec3;
use crate::error::OptimizeError;
use crate::executor::block_on;
use crate::lm::{Blocking, Observer, Termination, breath};

/// A clipped attempt leaves out observations beyond this angle or beyond this multiple of the median, whichever is
/// larger, and then points with fewer observations than this (`global-positioning.md` §4).
const CLIP_ANGLE_RAD: f64 = 1.0 * std::f64::consts::PI / 180.0;
const CLIP_MEDIANS: f64 = 4.0;
const CLIP_MIN_TRACK: usize = 3;
/// A pin is an inlier of the final scale when it is off by less than this part: beyond, Huber's loss bends.
const PIN_INLIER: f64 = 0.1;

/// Finds all camera centres and points, in `f64`. Deterministic: the same bytes whatever the number of threads.
///
/// The mean of the placed centres is the origin; the median distance from camera to point is 1, or metric with pins.
/// The observer sees every iteration of variable projection (numbered from 1 in each attempt); when it stops the solve,
/// the best state so far is the answer.
///
/// # Errors
/// [`OptimizeError`] for bad input ([`Problem::validate`]), when no point is seen by two images, or when a linear system
/// cannot be solved or stored. The problem is unchanged then.
pub fn solve(problem: &mut Problem, options: &Options, observer: &mut dyn Observer) -> Result<Report, OptimizeError> {
    solve_with::<f64>(problem, options, observer)
}

/// [`solve`] in `f32` or `f64`: the former is the twin that device kernels are tested against.
///
/// # Errors
/// As [`solve`].
pub fn solve_with<T: Real>(
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Report, OptimizeError> {
    block_on(solve_async::<T>(problem, options, &mut Blocking(observer)))
}

/// [`solve_with`] for a host that may not block: waits where the observer asks for a breath.
///
/// # Errors
/// As [`solve`].
pub async fn solve_async<T: Real>(
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Report, OptimizeError> {
    problem.validate()?;
    let layout = Layout::new(problem, None)?;
    breath(observer).await;
    let rays = Rays::<T>::new(problem, &layout);
    breath(observer).await;
    let mut backend = Cpu::new(&layout, &rays, options.linear_solver);
    let (report, positions) = solve_on(&mut backend, &layout, &rays, options, observer).await?;
    Ok(finish(problem, &layout, report, &positions))
}

/// What a solve found before it is written back: the attempts, which one counts, and the final fit of the scale.
pub(crate) struct Outcome {
    attempts: Vec<Attempt>,
    chosen: usize,
    metric_scale_correction: Option<f64>,
}

/// Start, variable projection and retries, on any backend. `rays` are those that the backend began with.
pub(crate) async fn solve_on<B: Backend>(
    backend: &mut B,
    layout: &Layout,
    rays: &Rays<B::Scalar>,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Positions<B::Scalar>), OptimizeError> {
    let mut run = Run { backend, layout, rays, options };
    let mut candidates = vec![run.attempt(Start::EqualScales, observer).await?];
    let mut chosen = 0;
    if options.retry && candidates[0].0.quality.grade() == Grade::Suspicious && !observer.should_stop() {
        candidates.push(run.attempt(Start::Lud, observer).await?);
        if candidates[1].0.lm.final_cost < candidates[0].0.lm.final_cost {
            chosen = 1;
        }
        if candidates[chosen].0.quality.grade() == Grade::Suspicious && !observer.should_stop() {
            let clipped = run.clip(&candidates[chosen].1, observer).await?;
            // Costs over different observations do not compare; the share of all rays that agree does.
            let better = clipped.0.quality.agreeing_share > candidates[chosen].0.quality.agreeing_share;
            candidates.push(clipped);
            if better {
                chosen = 2;
            }
        }
    }
    let mut positions = candidates[chosen].1.clone();
    let metric_scale_correction = rays.metric.then(|| fit_scale(layout, rays, &mut positions));
    let attempts = candidates.into_iter().map(|(attempt, _)| attempt).collect();
    Ok((Outcome { attempts, chosen, metric_scale_correction }, positions))
}

/// Writes the answer into the problem and reports on it.
pub(crate) fn finish<T: Real>(
    problem: &mut Problem,
    layout: &Layout,
    outcome: Outcome,
    positions: &Positions<T>,
) -> Report {
    let (single_view_points, unseen_points) = write_back(problem, layout, positions);
    let mut report = Report {
        attempts: outcome.attempts,
        chosen: outcome.chosen,
        observations: layout.observations(),
        components: components(layout),
        unplaced_images: unplaced(problem, layout),
        single_view_points,
        unseen_points,
        metric_scale_correction: outcome.metric_scale_correction,
        warnings: Vec::new(),
    };
    report.warnings = warnings(&report);
    report
}

/// What every attempt shares.
struct Run<'a, B: Backend> {
    backend: &'a mut B,
    layout: &'a Layout,
    rays: &'a Rays<B::Scalar>,
    options: &'a Options,
}

type Candidate<T> = (Attempt, Positions<T>);

impl<B: Backend> Run<'_, B> {
    async fn attempt(
        &mut self,
        start: Start,
        observer: &mut dyn Observer,
    ) -> Result<Candidate<B::Scalar>, OptimizeError> {
        let unit = unit(self.rays);
        let convex = match start {
            Start::Lud => lud(self.backend, unit, self.rays.metric, observer).await?,
            Start::EqualScales | Start::Clipped => equal_scales(self.backend, unit, observer).await?,
        };
        self.project(self.rays, start, convex, observer).await
    }

    /// Variable projection with `active` rays; the quality is taken over all.
    async fn project(
        &mut self,
        active: &Rays<B::Scalar>,
        start: Start,
        convex: ConvexReport,
        observer: &mut dyn Observer,
    ) -> Result<Candidate<B::Scalar>, OptimizeError> {
        let lm = self.backend.project(active, self.options, observer).await?;
        let positions = self.backend.positions().await?;
        breath(observer).await;
        let quality = quality(self.layout, &angles(self.layout, self.rays, &positions));
        Ok((Attempt { start, convex, lm, quality }, positions))
    }

    async fn clip(
        &mut self,
        positions: &Positions<B::Scalar>,
        observer: &mut dyn Observer,
    ) -> Result<Candidate<B::Scalar>, OptimizeError> {
        let angles = angles(self.layout, self.rays, positions);
        let limit = CLIP_ANGLE_RAD.max(CLIP_MEDIANS * median(angles.iter().copied()).unwrap_or(0.0));
        let mut active = self.rays.clone();
        for point in 0..self.layout.points() {
            let track = self.layout.track(point);
            let kept = track.clone().filter(|&o| angles[o] <= limit).count();
            for o in track {
                if angles[o] > limit || kept < CLIP_MIN_TRACK {
                    active.weight[o] = B::Scalar::ZERO;
                }
            }
        }
        self.backend.place(positions);
        self.project(&active, Start::Clipped, ConvexReport::default(), observer).await
    }
}

/// Scales the world so that the median pinned length fits: Huber's loss on multiplicative depth noise shrinks it by 2 to
/// 3 % (`reference/solver.md` §3.3). Returns the factor.
fn fit_scale<T: Real>(layout: &Layout, rays: &Rays<T>, positions: &mut Positions<T>) -> f64 {
    let ratios = (0..layout.observations()).filter(|&o| rays.pin[o] > T::ZERO).filter_map(|o| {
        let d = to_dvec3(positions.difference(layout, o));
        let pin = rays.pin[o].to_f64();
        let u = to_dvec3(rays.direction[o]) - pin * d;
        (u.length() < PIN_INLIER).then(|| 1.0 / (pin * d.length()))
    });
    let factor = median(ratios).filter(|f| f.is_finite() && *f > 0.0).unwrap_or(1.0);
    positions.rescale(factor);
    factor
}

/// Writes centres and points; returns how many points one image sees, and how many none.
fn write_back<T: Real>(problem: &mut Problem, layout: &Layout, positions: &Positions<T>) -> (usize, usize) {
    problem.centers.fill(DVec3::ZERO);
    for (camera, &image) in layout.image_of_camera.iter().enumerate() {
        problem.centers[image as usize] = to_dvec3(positions.centers[camera]);
    }
    let distance = positions.median_distance(layout);
    let (mut single, mut unseen) = (0, 0);
    let mut solved = layout.source_point.iter().copied().enumerate().peekable();
    for point in 0..problem.points.len() {
        if let Some((index, _)) = solved.next_if(|&(_, source)| source as usize == point) {
            problem.points[point] = to_dvec3(positions.points[index]);
            continue;
        }
        // A pinned observation knows best where a point lies that only one image sees.
        let track = problem.track(point);
        let best = track.clone().find(|&o| problem.pin(o).is_some()).or_else(|| track.clone().next());
        problem.points[point] = match best {
            Some(o) => {
                single += 1;
                let length = problem.pin(o).map_or(distance, |pin| 1.0 / pin);
                problem.centers[problem.observation_image[o] as usize] + length * problem.observation_ray[o]
            }
            None => {
                unseen += 1;
                DVec3::ZERO
            }
        };
    }
    (single, unseen)
}

fn components(layout: &Layout) -> Vec<Vec<u32>> {
    let count = layout.component.iter().max().map_or(0, |&last| last as usize + 1);
    let mut components = vec![Vec::new(); count];
    for (camera, &component) in layout.component.iter().enumerate() {
        components[component as usize].push(layout.image_of_camera[camera]);
    }
    // Stable: equal sizes stay in the order of their first image.
    components.sort_by_key(|images| std::cmp::Reverse(images.len()));
    components
}

fn unplaced(problem: &Problem, layout: &Layout) -> Vec<u32> {
    let placed = &layout.image_of_camera;
    (0..problem.centers.len() as u32).filter(|image| placed.binary_search(image).is_err()).collect()
}

fn warnings(report: &Report) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if report.components.len() > 1 {
        let images_outside = report.components[1..].iter().map(Vec::len).sum();
        warnings.push(Warning::Disconnected { components: report.components.len(), images_outside });
    }
    if !report.unplaced_images.is_empty() {
        warnings.push(Warning::ImagesWithoutTracks { count: report.unplaced_images.len() });
    }
    let kept = report.kept();
    if kept.quality.grade() == Grade::Suspicious {
        let quality = kept.quality;
        let (agreeing_share, worst_camera_share) = (quality.agreeing_share, quality.worst_camera_share);
        warnings.push(Warning::Suspicious { agreeing_share, worst_camera_share });
    }
    if kept.lm.termination == Termination::MaxIterations {
        warnings.push(Warning::NotConverged { iterations: kept.lm.iterations });
    }
    warnings
}
