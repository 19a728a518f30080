//! A finished model in the tab: what there is to say of it, and one more bundle adjustment.

use epipole_mapper::stages::refine::{Adjustment, adjust};
use epipole_mapper::{Component, Event, ImageReport, Observer, Stage};
use epipole_scene::Reconstruction;
use epipole_scene::statistics::{ImageErrors, Statistics, update_point_errors};
use serde::Serialize;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use crate::control::Wish;
use crate::error::Failure;
use crate::host::Host;
use crate::observer::now;
use crate::run::Run;
use crate::session::{Answer, Model, Session, to_js};

/// As much of `epipole_mapper::Report` as holds of a model that somebody else made.
#[derive(Serialize)]
struct ModelReport {
    num_images: usize,
    num_registered: usize,
    stopped: bool,
    components: [Statistics; 1],
    images: Vec<ImageReport>,
    stages: [(); 0],
    warnings: [(); 0],
}

impl ModelReport {
    fn new(model: &Reconstruction, stopped: bool) -> Self {
        let images = model.images.iter().zip(ImageErrors::of(model)).map(|(image, errors)| ImageReport {
            id: image.id,
            name: image.name.clone(),
            component: Some(0),
            points: errors.observations,
            mean_reprojection_error_px: errors.mean_px().filter(|mean| mean.is_finite()),
            unregistered: None,
        });
        Self {
            num_images: model.images.len(),
            num_registered: model.images.len(),
            stopped,
            components: [Statistics::of(model)],
            images: images.collect(),
            stages: [],
            warnings: [],
        }
    }
}

#[wasm_bindgen]
impl Session {
    /// What there is to say of an opened model, in the words of a run's report. Returns `Report`, or null.
    #[wasm_bindgen(js_name = modelReport)]
    pub fn model_report(&self) -> Answer<JsValue> {
        self.models.borrow().first().map_or(Ok(JsValue::NULL), |m| to_js(&ModelReport::new(&m.reconstruction, false)))
    }

    /// One bundle adjustment of an opened model until it has converged: nothing is filtered, no point is new. Settings and
    /// backend as for `solve`. Returns the report.
    pub async fn refine(&self, settings: JsValue, backend: String, host: Host) -> Answer<JsValue> {
        let name = &self.name;
        let model = self.models.borrow().first().map(|m| m.reconstruction.clone());
        let Some(reconstruction) = model else {
            return Err(Failure::new(name, "there is no model to refine", "drop the files of a COLMAP model").into());
        };
        let observations = reconstruction.num_observations();
        let Run { mut options, mut engine, mut observer } = self.begin(settings, &backend, observations, &host).await?;
        // Points of two observations move with their cameras or they are wrong afterwards.
        options.refine.min_track_length = 2;
        let graph_image: Vec<usize> = (0..reconstruction.images.len()).collect();
        let mut component = Component { reconstruction, graph_image: graph_image.clone(), ..Component::default() };
        let adjustment = Adjustment {
            stage: Stage::Refine,
            rotations_fixed: false,
            intrinsics: options.intrinsics,
            relative_decrease_tolerance: options.refine.final_relative_decrease_tolerance,
        };
        let start = now();
        observer.event(&Event::StageStarted { stage: Stage::Refine, component: 0 });
        let run = adjust(&mut component, &adjustment, &options.refine, &mut engine, &mut observer);
        let solved = self.unless_cancelled(run).await?.map_err(|e| Failure::new(name, e, ""))?;
        let reconstruction = &mut component.reconstruction;
        update_point_errors(reconstruction);
        let summary = format!(
            "{} iterations, cost {:.6e} to {:.6e}, mean reprojection error {:.3} px",
            solved.iterations,
            solved.initial_cost,
            solved.final_cost,
            Statistics::of(reconstruction).mean_reprojection_error_px
        );
        observer.event(&Event::StageFinished { stage: Stage::Refine, component: 0, seconds: now() - start, summary });
        let report = to_js(&ModelReport::new(reconstruction, self.wishes.get() == Wish::Stop))?;
        self.models.replace(vec![Model { reconstruction: component.reconstruction, graph_image }]);
        let _ = host.send("snapshot", &self.snapshot()?);
        Ok(report)
    }
}
