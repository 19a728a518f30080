//! A run of the pipeline in the tab.

use std::collections::BTreeMap;

use epipole_mapper::{Event, MapperError, Matches, Observer, Outcome, reconstruct};
use epipole_scene::ViewGraph;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use crate::error::Failure;
use crate::helpers::TabPool;
use crate::host::Host;
use crate::memory::{LIMIT_BYTES, predicted_bytes};
use crate::pictures::Decoded;
use crate::run::Run;
use crate::session::{Answer, Model, Session, to_js};

#[wasm_bindgen]
impl Session {
    /// Runs the pipeline. `settings` as a settings file has them; `backend` is `auto`, `gpu` or `cpu`. Returns the
    /// report.
    pub async fn solve(&self, settings: JsValue, backend: String, host: Host) -> Answer<JsValue> {
        let name = &self.name;
        let Some(graph) = &self.graph else {
            return Err(Failure::new(name, "a model has no matches to solve", "drop a database.db").into());
        };
        check_memory(name, graph)?;
        let keypoints = graph.images.iter().map(|image| image.keypoints_px.len()).sum();
        let Run { options, mut engine, mut observer } = self.begin(settings, &backend, keypoints, &host).await?;
        let mut warnings = Vec::new();
        let mut copy = match &self.source {
            Some((source, told)) if options.matches == Matches::Raw => {
                let (graph, mut said) = source.read(true)?;
                said.retain(|warning| !told.contains(warning));
                warnings = said;
                graph
            }
            _ => graph.clone(),
        };
        let depth_input = self.depths.attach(&mut copy, &options.depth, &mut observer).await?;
        if let Some(input) = &depth_input {
            warnings.extend(input.complaints(graph.images.len()));
            let _ = host.send("event", &to_js(&serde_json::json!({ "event": "depth_input", "depth_input": input }))?);
        }
        for message in &warnings {
            observer.event(&Event::Warning { message: message.clone() });
        }
        let mut decoded = Decoded { pictures: &self.pictures, host: host.clone() };
        let images = (!self.pictures.is_empty()).then_some(&mut decoded as &mut _);
        let mut pool = TabPool { host: host.clone(), deafness: self.deafness.clone() };
        let run = reconstruct(copy, &options, &mut engine, images, Some(&mut pool), &mut observer);
        let outcome = self.unless_cancelled(run).await?;
        let Outcome { reconstructions, mut report } = outcome.map_err(|e| match e {
            MapperError::Stopped => Failure::new(name, "stopped before any camera had a position", "let it run longer"),
            e => Failure::new(name, e, ""),
        })?;
        report.depth_input = depth_input;
        report.warnings.splice(0..0, warnings);
        let places: BTreeMap<u32, usize> = graph.images.iter().enumerate().map(|(k, image)| (image.id, k)).collect();
        let place = |image: &epipole_scene::Image| places.get(&image.id).copied().unwrap_or(0);
        let models = reconstructions.into_iter().map(|reconstruction| Model {
            graph_image: reconstruction.images.iter().map(place).collect(),
            reconstruction,
        });
        self.models.replace(models.collect());
        let answer = to_js(&report)?;
        self.report.replace(Some(report));
        let _ = host.send("snapshot", &self.snapshot()?);
        Ok(answer)
    }
}

/// A scene that cannot fit is refused before it takes the tab down.
fn check_memory(name: &str, graph: &ViewGraph) -> Result<(), Failure> {
    let predicted = predicted_bytes(graph);
    if predicted <= LIMIT_BYTES {
        return Ok(());
    }
    let message = format!(
        "solving it would take about {:.1} GB of memory and a tab has {:.1} GB",
        predicted / 1e9,
        LIMIT_BYTES / 1e9
    );
    Err(Failure::new(name, message, "use the command line: epipole reconstruct"))
}
