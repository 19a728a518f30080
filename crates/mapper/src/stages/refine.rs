//! Bundle adjustment in rounds: rotations held, then everything, then normalise and filter with a falling threshold.
//!
//! Source: GLOMAP's schedule with COLMAP 4.2's filter semantics (algorithms.md §2.8, §2.9).

use epipole_geometry::camera::{Camera, MAX_PARAMS};
use epipole_optimize::Engine;
use epipole_optimize::bundle::{self, ParamPrior, PoseFreedom};
use epipole_optimize::engine::Notice;
use epipole_optimize::lm::{Breath, IterationRecord, LmReport, Places};
use epipole_optimize::loss::Loss;
use epipole_scene::filter;
use serde::{Deserialize, Serialize};

use crate::component::Component;
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};
use crate::options::Intrinsics;

/// Bundle adjustment and its filters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Rounds of adjustment and filtering (GLOMAP: 3).
    pub rounds: usize,
    /// Whether a round first adjusts with rotations held (GLOMAP does: positions settle before rotations follow them).
    pub fixed_rotation_stage: bool,
    /// Huber threshold, px (GLOMAP: 1).
    pub huber_px: f64,
    /// Final bound of the reprojection error on the plane z = 1 (GLOMAP: 1e-2, about 10 px at f = 1000 px).
    pub max_normalized_error: f64,
    /// Points all of whose rays are closer than this are dropped, degrees (GLOMAP: 1).
    pub min_triangulation_angle_deg: f64,
    /// Points with fewer observations do not take part (GLOMAP: 3).
    pub min_track_length: usize,
    /// Share of points below which filtered observations do not justify another round (GLOMAP: 0.1 %).
    pub settled_share: f64,
    /// Levenberg–Marquardt iterations at most, per solve.
    pub max_iterations: usize,
    /// Stop of the intermediate solves: relative decrease of the cost. The next filter moves the optimum by far more: from
    /// 1e-4 to 1e-3 no scene's AUC@1 changed by more than 0.1, or 0.5 on the ill-conditioned colmap2017_db.
    pub relative_decrease_tolerance: f64,
    /// Stop of the last solve (COLMAP: 1e-5).
    pub final_relative_decrease_tolerance: f64,
    /// With `intrinsics: prior`: standard deviation of the focal length relative to its prior.
    /// EXIF focal lengths of fixed lenses are good to about a percent, guesses to a few tens.
    pub prior_focal_sigma: f64,
    /// With `intrinsics: prior`: the same for a camera whose focal length is a guess.
    pub guessed_focal_sigma: f64,
    /// With `intrinsics: prior`: standard deviation of every distortion parameter.
    pub prior_distortion_sigma: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rounds: 3,
            fixed_rotation_stage: true,
            huber_px: 1.0,
            max_normalized_error: 1e-2,
            min_triangulation_angle_deg: 1.0,
            min_track_length: 3,
            settled_share: 1e-3,
            max_iterations: 50,
            relative_decrease_tolerance: 1e-3,
            final_relative_decrease_tolerance: 1e-5,
            prior_focal_sigma: 0.02,
            guessed_focal_sigma: 0.2,
            prior_distortion_sigma: 0.1,
        }
    }
}

/// One solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adjustment {
    /// The stage that asks, for events.
    pub stage: Stage,
    /// Hold every rotation.
    pub rotations_fixed: bool,
    /// What may happen to the intrinsics.
    pub intrinsics: Intrinsics,
    /// Relative decrease at which the solve ends.
    pub relative_decrease_tolerance: f64,
}

/// What the rounds did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Observations before the first round.
    pub observations_before: usize,
    /// Observations after the last filter.
    pub observations_after: usize,
    /// Solves that ran.
    pub solves: usize,
    /// Their Levenberg–Marquardt iterations.
    pub iterations: usize,
}

/// Adjusts poses, points and intrinsics of a component once.
pub async fn adjust(
    component: &mut Component,
    adjustment: &Adjustment,
    options: &Options,
    engine: &mut Engine,
    observer: &mut dyn Observer,
) -> Result<LmReport, MapperError> {
    component.metric.refit(&mut component.reconstruction);
    let reconstruction = &component.reconstruction;
    let mut problem = bundle::Problem {
        cam_from_world: reconstruction.images.iter().map(|i| i.cam_from_world).collect(),
        image_camera: reconstruction.images.iter().map(|i| i.camera as u32).collect(),
        pose_freedom: vec![
            if adjustment.rotations_fixed { PoseFreedom::RotationFixed } else { PoseFreedom::Free };
            reconstruction.images.len()
        ],
        refine_params: reconstruction.cameras.iter().map(|c| refined(c, adjustment.intrinsics)).collect(),
        param_priors: reconstruction.cameras.iter().map(|c| priors(c, adjustment.intrinsics, options)).collect(),
        cameras: reconstruction.cameras.clone(),
        points: Vec::new(),
        fixed_points: false,
        track_start: vec![0],
        observation_image: Vec::new(),
        observation_px: Vec::new(),
        loss: Loss::Huber(options.huber_px),
        depth: None,
    };
    let mut adjusted = Vec::new();
    for (p, point) in reconstruction.points.iter().enumerate() {
        if point.observations.len() < options.min_track_length {
            continue;
        }
        adjusted.push(p);
        problem.points.push(point.position);
        for o in &point.observations {
            problem.observation_image.push(o.image);
            problem.observation_px.push(reconstruction.images[o.image as usize].keypoints_px[o.keypoint as usize]);
        }
        problem.track_start.push(problem.observation_image.len() as u32);
    }
    let observations = adjusted.iter().flat_map(|&p| reconstruction.points[p].observations.iter().copied());
    problem.depth = component.metric.rows(reconstruction, observations);
    let mut lm_options = bundle::Options::default();
    lm_options.lm.max_iterations = options.max_iterations;
    lm_options.lm.relative_decrease_tolerance = adjustment.relative_decrease_tolerance;
    // A second small step confirms convergence; before another filter or another round there is nothing to confirm.
    let is_final = adjustment.relative_decrease_tolerance <= options.final_relative_decrease_tolerance;
    lm_options.lm.small_decreases = if is_final { 2 } else { 1 };
    breath(observer).await;
    let mut forward = Forward { stage: adjustment.stage, component, points: Some(&adjusted), observer };
    let report = engine.adjust(&mut problem, &lm_options, &mut forward).await?;
    let reconstruction = &mut component.reconstruction;
    for (image, pose) in reconstruction.images.iter_mut().zip(&problem.cam_from_world) {
        image.cam_from_world = *pose;
    }
    reconstruction.cameras = problem.cameras;
    for (&p, &position) in adjusted.iter().zip(&problem.points) {
        reconstruction.points[p].position = position;
    }
    observer.snapshot(component, false);
    breath(observer).await;
    Ok(report)
}

/// Passes iterations and notices on as events, and positions as previews of a component.
pub(crate) struct Forward<'a> {
    pub(crate) stage: Stage,
    pub(crate) component: &'a Component,
    /// For every point of the problem its index in the component; `None`: the same.
    pub(crate) points: Option<&'a [usize]>,
    pub(crate) observer: &'a mut dyn Observer,
}

impl epipole_optimize::lm::Observer for Forward<'_> {
    fn iteration(&mut self, record: &IterationRecord) {
        self.observer.event(&Event::Iteration {
            stage: self.stage,
            iteration: record.iteration,
            cost: record.cost,
            damping: record.lambda,
            active_observations: record.active,
            accepted: record.accepted,
        });
    }

    fn notice(&mut self, notice: &Notice) {
        let message = notice.to_string();
        self.observer.event(&match notice.clone() {
            Notice::DeviceLost { reason, resumed_on } => {
                Event::DeviceLost { stage: self.stage, reason, resumed_on, message }
            }
            Notice::OnCpu { .. } => Event::Warning { message },
        });
    }

    fn wants_places(&self) -> bool {
        self.observer.wants_preview()
    }

    fn places(&mut self, places: &Places) {
        let Some(index) = self.points else { return self.observer.preview(self.component, places) };
        let points = places.points.iter().map(|&(p, position)| (index[p as usize] as u32, position));
        self.observer.preview(self.component, &Places { centers: places.centers.clone(), points: points.collect() });
    }

    fn should_stop(&self) -> bool {
        self.observer.should_stop()
    }

    fn interrupts(&self) -> bool {
        self.observer.interrupts()
    }

    fn heard(&mut self) {
        self.observer.heard();
    }

    fn breathe(&mut self) -> Option<Breath> {
        self.observer.breathe()
    }
}

/// Principal points stay: they trade off against rotations and are best left to calibration (COLMAP's default too).
fn refined(camera: &Camera, intrinsics: Intrinsics) -> [bool; MAX_PARAMS] {
    let mut moves = [false; MAX_PARAMS];
    if intrinsics != Intrinsics::Fixed {
        for &i in camera.model.focal_params().iter().chain(camera.model.extra_params()) {
            moves[i] = true;
        }
    }
    moves
}

fn priors(camera: &Camera, intrinsics: Intrinsics, options: &Options) -> Vec<ParamPrior> {
    if intrinsics != Intrinsics::Prior {
        return Vec::new();
    }
    let relative = if camera.has_prior_focal { options.prior_focal_sigma } else { options.guessed_focal_sigma };
    let focal = camera.model.focal_params().iter().map(|&index| ParamPrior {
        index,
        mean: camera.params[index],
        sigma: relative * camera.params[index].abs(),
    });
    let extra = camera.model.extra_params().iter().map(|&index| ParamPrior {
        index,
        mean: camera.params[index],
        sigma: options.prior_distortion_sigma,
    });
    focal.chain(extra).collect()
}

/// All rounds.
pub async fn run(
    component: &mut Component,
    intrinsics: Intrinsics,
    options: &Options,
    engine: &mut Engine,
    observer: &mut dyn Observer,
) -> Result<Summary, MapperError> {
    let mut summary =
        Summary { observations_before: component.reconstruction.num_observations(), ..Summary::default() };
    let mut round = 0;
    while round < options.rounds && !observer.should_stop() {
        observer.event(&Event::Progress { stage: Stage::Refine, done: round, total: options.rounds });
        for rotations_fixed in [true, false] {
            if rotations_fixed && !options.fixed_rotation_stage {
                continue;
            }
            let adjustment = Adjustment {
                stage: Stage::Refine,
                rotations_fixed,
                intrinsics,
                relative_decrease_tolerance: options.relative_decrease_tolerance,
            };
            let report = adjust(component, &adjustment, options, engine, observer).await?;
            summary.solves += 1;
            summary.iterations += report.iterations;
        }
        component.normalize();
        // A round that filters next to nothing would repeat itself: go on to the next, stricter threshold instead.
        let mut filtered = 0;
        while round < options.rounds {
            let factor = (options.rounds as f64 - round as f64).clamp(1.0, 3.0);
            round += 1;
            filtered += filter::filter_normalized(&mut component.reconstruction, factor * options.max_normalized_error)
                .observations;
            if filtered as f64 > options.settled_share * component.reconstruction.points.len() as f64 {
                break;
            }
        }
    }
    final_filter(component, options);
    observer.event(&Event::Progress { stage: Stage::Refine, done: options.rounds, total: options.rounds });
    summary.observations_after = component.reconstruction.num_observations();
    Ok(summary)
}

/// The filters that end bundle adjustment.
pub fn final_filter(component: &mut Component, options: &Options) {
    filter::filter_normalized(&mut component.reconstruction, options.max_normalized_error);
    filter::filter_triangulation_angle(&mut component.reconstruction, options.min_triangulation_angle_deg.to_radians());
}
