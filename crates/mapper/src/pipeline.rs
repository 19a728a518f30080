//! All stages in order: the graph-wide ones once, the others component by component, largest first.

use std::collections::VecDeque;

use epipole_optimize::Engine;
use epipole_optimize::executor::block_on;
use epipole_optimize::lm::{Breath, Places};
use epipole_scene::statistics::Statistics;
use epipole_scene::{Reconstruction, ViewGraph};

use crate::component::Component;
use crate::correspondences::CorrespondenceGraph;
use crate::error::MapperError;
use crate::event::{Event, Observer, Stage, breath};
use crate::metric::DepthStages;
use crate::options::Options;
use crate::reasons::{Reasons, image_reports};
use crate::report::{ComponentReport, Report, StageTime, UnregisteredReason};
use crate::stages::finish::ImageSource;
use crate::stages::refine::Adjustment;
use crate::stages::relative_pose::PairPool;
use crate::stages::rotation::RotationComponent;
use crate::stages::{calibrate, finish, position, refine, relative_pose, retriangulate, rotation, tracks};

/// What a run leaves.
#[derive(Debug)]
pub struct Outcome {
    /// One reconstruction a component, largest first.
    pub reconstructions: Vec<Reconstruction>,
    /// What happened.
    pub report: Report,
}

/// Reconstructs every component of a view graph.
///
/// After the observer asks to stop, the component at hand is filtered and kept if its cameras already have positions,
/// the others are left out, and the report says so.
///
/// Async because a device answers later and a browser tab may not block; native callers have [`reconstruct_blocking`]. They
/// have threads too, and need no `pool`.
pub async fn reconstruct(
    mut graph: ViewGraph,
    options: &Options,
    engine: &mut Engine,
    mut images: Option<&mut dyn ImageSource>,
    pool: Option<&mut dyn PairPool>,
    observer: &mut dyn Observer,
) -> Result<Outcome, MapperError> {
    if graph.images.len() < 2 {
        return Err(MapperError::TooFewImages(graph.images.len()));
    }
    let mut run = Run { observer, engine, stages: Vec::new(), warnings: Vec::new() };
    let mut reasons = Reasons::of_graph(&graph);

    run.stage(Stage::Calibrate, 0, async |observer, _| {
        let summary = calibrate::run(&mut graph, &options.calibrate, observer)?;
        Ok(((), summary.to_string()))
    })
    .await?;
    run.stage(Stage::RelativePose, 0, async |observer, _| {
        let (matches, seed) = (options.matches, options.seed);
        let summary = relative_pose::run(&mut graph, &options.relative_pose, matches, seed, pool, observer).await?;
        Ok(((), summary.to_string()))
    })
    .await?;
    if graph.pairs.is_empty() {
        return Err(MapperError::NoPairs {
            min_inliers: options.relative_pose.min_inliers,
            hint: "match more pairs, or lower relative_pose.min_inliers in a settings file".into(),
        });
    }
    reasons.after_relative_poses(&graph);
    let rotations = run
        .stage(Stage::Rotation, 0, async |observer, _| {
            let rotations = rotation::run(&graph, &options.rotation, observer).await?;
            let summary = rotations.to_string();
            Ok((rotations, summary))
        })
        .await?;
    reasons.after_rotations(&rotations, options.min_component_images);

    // Retriangulation judges every match by itself, so pairs that rotation averaging found fault with count as well:
    // on colmap2017_db they bring AUC@5 from 80.2 to 86.8, on castle-P19 six per cent more points.
    breath(run.observer).await;
    let correspondences = CorrespondenceGraph::new(&graph, &vec![true; graph.pairs.len()]);
    breath(run.observer).await;
    let mut finished = Vec::new();
    let mut parts: VecDeque<RotationComponent> = rotations.components.iter().cloned().collect();
    while let Some(part) = parts.pop_front() {
        if part.images.len() < options.min_component_images {
            continue;
        }
        if run.observer.should_stop() {
            reasons.set(part.images.iter().map(|&(i, _)| i), &UnregisteredReason::Stopped);
            continue;
        }
        let number = finished.len();
        let built = reconstruct_component(
            &graph,
            &part,
            &rotations,
            &correspondences,
            options,
            number,
            &mut images,
            &mut run,
            &mut reasons,
            &mut parts,
        )
        .await;
        match built {
            Ok((component, report)) => {
                let (images, points) = (component.reconstruction.images.len(), component.reconstruction.points.len());
                run.observer.event(&Event::ComponentFinished { component: number, images, points });
                run.observer.snapshot(&component, true);
                reasons.clear(&component.graph_image);
                finished.push((component, report));
            }
            Err(MapperError::Stopped) => {
                reasons.set(part.images.iter().map(|&(i, _)| i), &UnregisteredReason::Stopped);
            }
            Err(e) => {
                let message = e.to_string();
                run.warn(format!("a component of {} images could not be reconstructed: {message}", part.images.len()));
                reasons.set(part.images.iter().map(|&(i, _)| i), &UnregisteredReason::ComponentFailed { message });
            }
        }
    }
    let stopped = run.observer.should_stop();
    if finished.is_empty() {
        return Err(match stopped {
            true => MapperError::Stopped,
            false => MapperError::NothingReconstructed(match run.warnings.last() {
                Some(why) => why.clone(),
                None => format!(
                    "the largest has {} images, fewer than min_component_images = {}",
                    rotations.components.first().map_or(0, |c| c.images.len()),
                    options.min_component_images
                ),
            }),
        });
    }
    // Filtering can turn the order of sizes round; the folders are numbered by what is left.
    finished.sort_by_key(|(component, _)| std::cmp::Reverse(component.reconstruction.images.len()));
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        options: options.clone(),
        depth_input: None,
        num_images: graph.images.len(),
        num_registered: finished.iter().map(|(c, _)| c.reconstruction.images.len()).sum(),
        stopped,
        components: finished.iter().map(|(_, report)| report.clone()).collect(),
        images: image_reports(&graph, &finished, &reasons),
        stages: run.stages,
        warnings: run.warnings,
    };
    Ok(Outcome { reconstructions: finished.into_iter().map(|(c, _)| c.reconstruction).collect(), report })
}

/// [`reconstruct`] for callers that may wait: everything but a browser tab.
pub fn reconstruct_blocking(
    graph: ViewGraph,
    options: &Options,
    engine: &mut Engine,
    images: Option<&mut dyn ImageSource>,
    observer: &mut dyn Observer,
) -> Result<Outcome, MapperError> {
    block_on(reconstruct(graph, options, engine, images, None, observer))
}

/// Tracks to finish, for one component.
async fn reconstruct_component(
    graph: &ViewGraph,
    part: &RotationComponent,
    rotations: &rotation::Rotations,
    correspondences: &CorrespondenceGraph,
    options: &Options,
    number: usize,
    images: &mut Option<&mut dyn ImageSource>,
    run: &mut Run<'_>,
    reasons: &mut Reasons,
    parts: &mut VecDeque<RotationComponent>,
) -> Result<(Component, ComponentReport), MapperError> {
    let mut component = Component::new(graph, &part.images, &options.metric);
    let tracks = run
        .stage(Stage::Tracks, number, async |observer, _| {
            let mut in_component = vec![false; graph.images.len()];
            for &(i, _) in &part.images {
                in_component[i] = true;
            }
            let tracks = tracks::run(graph, &in_component, &rotations.kept_pairs, &options.tracks, observer).await?;
            let summary = format!("{} tracks, {} observations", tracks.len(), tracks.observations.len());
            Ok((tracks, summary))
        })
        .await?;
    if tracks.is_empty() {
        return Err(MapperError::NothingReconstructed(
            "no keypoint is matched across three or more images; match more pairs of each image".into(),
        ));
    }
    let positioned = run
        .stage(Stage::Position, number, async |observer, engine| {
            let positioned = position::run(graph, &tracks, &mut component, &options.position, engine, observer).await?;
            let summary = format!(
                "{} of {} observations kept, {:.1} % within 1°",
                component.reconstruction.num_observations(),
                positioned.observations,
                100.0 * positioned.report.kept().quality.agreeing_share
            );
            Ok((positioned, summary))
        })
        .await?;
    drop(tracks);
    reasons.set(positioned.without_tracks.iter().copied(), &UnregisteredReason::NoTracks);
    for group in &positioned.left_over {
        let is_in = |image: usize| group.binary_search(&image).is_ok();
        let rest = part.images.iter().copied().filter(|&(image, _)| is_in(image)).collect();
        reasons.set(group.iter().copied(), &UnregisteredReason::SmallComponent { images: group.len() });
        parts.push_back(RotationComponent { images: rest });
    }
    reasons.set(component.graph_image.iter().copied(), &UnregisteredReason::NoObservationsLeft);
    let refined = run
        .stage(Stage::Refine, number, async |observer, engine| {
            let summary = refine::run(&mut component, options.intrinsics, &options.refine, engine, observer).await?;
            let text = format!(
                "{} solves, {} iterations, {} of {} observations kept",
                summary.solves, summary.iterations, summary.observations_after, summary.observations_before
            );
            Ok((summary, text))
        })
        .await?;
    let kept = refined.observations_after as f64 / positioned.observations.max(1) as f64;
    // global-positioning.md §5: failed runs kept 4 %, doubtful ones 10–30 %.
    if kept < 0.1 {
        return Err(MapperError::NothingReconstructed(format!(
            "bundle adjustment kept only {:.1} % of the observations; the matches contradict each other",
            100.0 * kept
        )));
    }
    if kept < 0.3 {
        run.warn(format!(
            "component {number}: bundle adjustment kept only {:.0} % of the observations; check the result",
            100.0 * kept
        ));
    }
    if options.retriangulate.enabled && !run.observer.should_stop() {
        run.stage(Stage::Retriangulate, number, async |observer, engine| {
            let summary = retriangulated(correspondences, &mut component, options, engine, observer).await?;
            Ok(((), summary))
        })
        .await?;
    }
    let metric = run
        .stage(Stage::Finish, number, async |observer, _| {
            let source = images.as_mut().map(|i| &mut **i as &mut dyn ImageSource);
            let summary = finish::run(&mut component, source, &options.finish, observer).await?;
            let metric = component.metric.report(&component.reconstruction);
            let scale = metric.as_ref().map_or(String::new(), |metric| format!("; {metric}"));
            Ok((metric, format!("{summary}{scale}")))
        })
        .await?;
    let has_depth = |image: &epipole_scene::ViewImage| image.depths.as_ref().is_some_and(|d| d.num_known() > 0);
    if metric.is_none() && options.metric.stages != DepthStages::Off && graph.images.iter().any(has_depth) {
        run.warn(format!(
            "component {number} is not in metres: no depths that could be believed; its unit is arbitrary"
        ));
    }
    let reconstruction = &component.reconstruction;
    if reconstruction.images.len() < options.min_component_images {
        return Err(MapperError::NothingReconstructed(format!(
            "only {} images still observe points after filtering",
            reconstruction.images.len()
        )));
    }
    let statistics = Statistics::of(reconstruction);
    let report = ComponentReport {
        images: statistics.images,
        points: statistics.points,
        observations: statistics.observations,
        mean_reprojection_error_px: statistics.mean_reprojection_error_px,
        mean_track_length: statistics.mean_track_length,
        positioning_ok_share: positioned.report.kept().quality.agreeing_share,
        positioning_ok_share_worst_camera: positioned.report.kept().quality.worst_camera_share,
        observations_kept_share: kept,
        metric,
    };
    Ok((component, report))
}

/// Retriangulation with its adjustments, then the last adjustment and filters.
async fn retriangulated(
    correspondences: &CorrespondenceGraph,
    component: &mut Component,
    options: &Options,
    engine: &mut Engine,
    observer: &mut dyn Observer,
) -> Result<String, MapperError> {
    let adjustment = Adjustment {
        stage: Stage::Retriangulate,
        rotations_fixed: false,
        intrinsics: options.intrinsics,
        relative_decrease_tolerance: options.refine.relative_decrease_tolerance,
    };
    let mut adjust = async |component: &mut Component, observer: &mut dyn Observer| {
        refine::adjust(component, &adjustment, &options.refine, engine, observer).await?;
        component.normalize();
        Ok(())
    };
    let summary =
        retriangulate::run(correspondences, component, &options.retriangulate, options.seed, &mut adjust, observer)
            .await?;
    refine::final_filter(component, &options.refine);
    let last =
        Adjustment { relative_decrease_tolerance: options.refine.final_relative_decrease_tolerance, ..adjustment };
    refine::adjust(component, &last, &options.refine, engine, observer).await?;
    component.normalize();
    refine::final_filter(component, &options.refine);
    Ok(summary.to_string())
}

/// The observer and the engine with the bookkeeping of the report.
struct Run<'a> {
    observer: &'a mut dyn Observer,
    engine: &'a mut Engine,
    stages: Vec<StageTime>,
    warnings: Vec<String>,
}

impl Run<'_> {
    async fn stage<T>(
        &mut self,
        stage: Stage,
        component: usize,
        work: impl AsyncFnOnce(&mut dyn Observer, &mut Engine) -> Result<(T, String), MapperError>,
    ) -> Result<T, MapperError> {
        self.observer.event(&Event::StageStarted { stage, component });
        breath(self.observer).await;
        let start = self.observer.now_seconds();
        let mut recorder = Recorder { inner: self.observer, warnings: &mut self.warnings };
        let (result, summary) = work(&mut recorder, self.engine).await?;
        let seconds = self.observer.now_seconds() - start;
        self.observer.event(&Event::StageFinished { stage, component, seconds, summary: summary.clone() });
        self.stages.push(StageTime { stage, component, seconds, summary });
        Ok(result)
    }

    fn warn(&mut self, message: String) {
        self.observer.event(&Event::Warning { message: message.clone() });
        self.warnings.push(message);
    }
}

/// Keeps the warnings of a stage for the report while passing every event on.
struct Recorder<'a> {
    inner: &'a mut dyn Observer,
    warnings: &'a mut Vec<String>,
}

impl Observer for Recorder<'_> {
    fn event(&mut self, event: &Event) {
        if let Event::Warning { message } | Event::DeviceLost { message, .. } = event {
            self.warnings.push(message.clone());
        }
        self.inner.event(event);
    }

    fn should_stop(&self) -> bool {
        self.inner.should_stop()
    }

    fn interrupts(&self) -> bool {
        self.inner.interrupts()
    }

    fn heard(&mut self) {
        self.inner.heard();
    }

    fn snapshot(&mut self, component: &Component, complete: bool) {
        self.inner.snapshot(component, complete);
    }

    fn wants_preview(&self) -> bool {
        self.inner.wants_preview()
    }

    fn preview(&mut self, component: &Component, places: &Places) {
        self.inner.preview(component, places);
    }

    fn breathe(&mut self) -> Option<Breath> {
        self.inner.breathe()
    }

    fn now_seconds(&self) -> f64 {
        self.inner.now_seconds()
    }
}
