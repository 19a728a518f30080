//! One scene: opened, solved, asked about, exported.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

use epipole_formats::{FormatWarning, ReadOptions, read_model_files, read_ranged_database};
use epipole_mapper::{MapperError, Report, Settings, reconstruct};
use epipole_scene::{Reconstruction, ViewGraph};
use js_sys::{Array, Function, Object, Reflect, Uint8Array};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};
use web_sys::File;

use crate::backend::{self, Chosen};
use crate::bytes::TabFile;
use crate::control::{Control, Wish, Wishes};
use crate::error::Failure;
use crate::export::{self, Filter};
use crate::memory::{LIMIT_BYTES, predicted_bytes};
use crate::observer::TabObserver;
use crate::pictures::Pictures;
use crate::snapshot::Arrays;
use crate::{opened, query};

/// A reconstruction and where its images stand among all that were opened.
struct Model {
    reconstruction: Reconstruction,
    graph_image: Vec<usize>,
}

/// What the worker holds of a scene. A run only borrows it, so that the page can ask about images while it waits: what a
/// run changes is in cells, and none is borrowed across a breath.
#[wasm_bindgen]
pub struct Session {
    name: String,
    graph: Option<ViewGraph>,
    models: RefCell<Vec<Model>>,
    pictures: RefCell<Pictures>,
    report: RefCell<Option<Report>>,
    wishes: Wishes,
}

type Answer<T> = Result<T, JsValue>;

fn texts(warnings: &[FormatWarning]) -> Vec<String> {
    warnings.iter().map(ToString::to_string).collect()
}

fn tab_file(name: &str, file: File) -> Result<TabFile, Failure> {
    TabFile::new(file).map_err(|message| Failure::new(name, message, "reload the page"))
}

fn base(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

#[wasm_bindgen]
impl Session {
    /// An empty scene.
    #[wasm_bindgen(constructor)]
    #[allow(clippy::new_without_default)]
    pub fn new() -> Self {
        Self {
            name: String::new(),
            graph: None,
            models: RefCell::default(),
            pictures: RefCell::default(),
            report: RefCell::default(),
            wishes: Wishes::default(),
        }
    }

    /// The switch for stopping runs of this scene.
    pub fn control(&self) -> Control {
        Control(self.wishes.clone())
    }

    /// Opens a COLMAP database by ranges. Returns `Opened`.
    #[wasm_bindgen(js_name = openDatabase)]
    pub fn open_database(&mut self, path: &str, database: File, wal: Option<File>) -> Answer<JsValue> {
        let bytes = database.size();
        let database = Rc::new(tab_file(path, database)?);
        let wal = match wal {
            Some(wal) => Some(Rc::new(tab_file(path, wal)?) as Rc<dyn epipole_formats::RangedBytes>),
            None => None,
        };
        let loaded = read_ranged_database(Path::new(path), database, wal, &ReadOptions::default())
            .map_err(|e| Failure::format(path, &e))?;
        let predicted = predicted_bytes(&loaded.value);
        let answer = opened::graph(base(path), &loaded.value, texts(&loaded.warnings), bytes, predicted)?;
        self.name = base(path).to_owned();
        self.graph = Some(loaded.value);
        Ok(answer)
    }

    /// Opens the files of a COLMAP model for viewing. Returns `Opened`.
    #[wasm_bindgen(js_name = openModel)]
    pub fn open_model(&mut self, folder: &str, names: Vec<String>, files: Vec<File>) -> Answer<JsValue> {
        let mut read = Vec::new();
        let mut bytes = 0.0;
        for (name, file) in names.into_iter().zip(files) {
            bytes += file.size();
            let content = tab_file(&name, file)?.read().map_err(|e| Failure::new(&name, e, "drop the files again"))?;
            read.push((base(&name).to_owned(), content));
        }
        let loaded = read_model_files(Path::new(folder), &read).map_err(|e| Failure::format(folder, &e))?;
        let answer = opened::model(folder, &loaded.value, texts(&loaded.warnings), bytes)?;
        let graph_image = (0..loaded.value.images.len()).collect();
        self.name = folder.to_owned();
        self.models = RefCell::new(vec![Model { reconstruction: loaded.value, graph_image }]);
        Ok(answer)
    }

    /// Photographs by image name, for colours.
    #[wasm_bindgen(js_name = addPicture)]
    pub fn add_picture(&self, name: &str, file: File) -> Answer<()> {
        self.pictures.borrow_mut().add(name.to_owned(), tab_file(name, file)?);
        Ok(())
    }

    /// Runs the pipeline. `settings` as a settings file has them; `backend` is `auto`, `gpu` or `cpu`; `send(kind, value)`
    /// gets events, snapshots and where it runs; `breathe()` gives a promise that is kept when the run may go on.
    /// Returns the report.
    pub async fn solve(
        &self,
        settings: JsValue,
        backend: String,
        send: Function,
        breathe: Function,
    ) -> Answer<JsValue> {
        let name = self.name.clone();
        let Some(graph) = &self.graph else {
            return Err(Failure::new(&name, "a model has no matches to solve", "drop a database.db").into());
        };
        let predicted = predicted_bytes(graph);
        if predicted > LIMIT_BYTES {
            let message = format!(
                "solving it would take about {:.1} GB of memory and a tab has {:.1} GB",
                predicted / 1e9,
                LIMIT_BYTES / 1e9
            );
            return Err(Failure::new(&name, message, "use the command line: epipole reconstruct").into());
        }
        let settings: serde_json::Map<String, serde_json::Value> = serde_wasm_bindgen::from_value(settings)
            .map_err(|e| Failure::new("settings", e, "write an object such as {\"preset\": \"fast\"}"))?;
        let options = Settings(settings).resolve().map_err(|e| Failure::new("settings", e, ""))?;
        self.wishes.set(Wish::GoOn);
        let mut observer = TabObserver::new(self.wishes.clone(), send.clone(), breathe);
        let mut pictures = self.pictures.take();
        let images = (!pictures.is_empty()).then_some(&mut pictures as &mut _);
        let keypoints = graph.images.iter().map(|image| image.keypoints_px.len()).sum();
        let Chosen { mut engine, place } = backend::choose(&backend, keypoints).await?;
        let _ = send.call2(&JsValue::NULL, &"backend".into(), &to_js(&place)?);
        let outcome = reconstruct(graph.clone(), &options, &mut engine, images, &mut observer).await;
        // Those that came meanwhile stay too.
        self.pictures.borrow_mut().join(pictures);
        if self.wishes.get() == Wish::Cancel {
            return Err(Failure::new(&name, "cancelled", "").into());
        }
        let outcome = outcome.map_err(|e| match e {
            MapperError::Stopped => {
                Failure::new(&name, "stopped before any camera had a position", "let it run longer")
            }
            e => Failure::new(&name, e, ""),
        })?;
        let places: std::collections::BTreeMap<u32, usize> =
            graph.images.iter().enumerate().map(|(k, image)| (image.id, k)).collect();
        let models = outcome
            .reconstructions
            .into_iter()
            .map(|reconstruction| Model {
                graph_image: reconstruction
                    .images
                    .iter()
                    .map(|image| places.get(&image.id).copied().unwrap_or(0))
                    .collect(),
                reconstruction,
            })
            .collect();
        self.models.replace(models);
        let report = to_js(&outcome.report)?;
        self.report.replace(Some(outcome.report));
        let _ = send.call2(&JsValue::NULL, &"snapshot".into(), &self.snapshot()?);
        Ok(report)
    }

    /// The scene as it is. Returns `Snapshot`.
    pub fn snapshot(&self) -> Answer<JsValue> {
        let mut arrays = Arrays::default();
        for (number, model) in self.models.borrow().iter().enumerate() {
            arrays.push(number, &model.reconstruction, |k| model.graph_image[k]);
        }
        arrays.to_js(true)
    }

    /// x, y of every keypoint of an image, px.
    pub fn keypoints(&self, image: usize) -> Vec<f32> {
        if let Some(graph) = &self.graph {
            return graph.images.get(image).map_or_else(Vec::new, |image| query::keypoints(&image.keypoints_px));
        }
        self.of_image(image, |model, k| query::keypoints(&model.images[k].keypoints_px))
    }

    /// Reprojection error of every keypoint of an image, px; −1 where it observes no point.
    pub fn residuals(&self, image: usize) -> Vec<f32> {
        self.of_image(image, query::residuals)
    }

    /// Verified matches, five numbers each: x, y here, x, y there, 1.
    pub fn matches(&self, image: usize, other: usize) -> Vec<f32> {
        match &self.graph {
            Some(graph) if image.max(other) < graph.images.len() => query::matches(graph, image, other),
            _ => Vec::new(),
        }
    }

    /// A point, counted through all components, and its observations.
    pub fn track(&self, point: usize) -> Answer<JsValue> {
        let mut index = point;
        for model in self.models.borrow().iter() {
            if index < model.reconstruction.points.len() {
                let track = query::track(&model.reconstruction, index, |k| model.graph_image[k]);
                return track.map_or(Ok(JsValue::NULL), |track| to_js(&track));
            }
            index -= model.reconstruction.points.len();
        }
        Ok(JsValue::NULL)
    }

    /// Files to download: an array of `{ path, bytes }`.
    pub fn export(
        &self,
        formats: Vec<String>,
        component: Option<usize>,
        filter: JsValue,
        settings: JsValue,
    ) -> Answer<Array> {
        let filter: Filter = serde_wasm_bindgen::from_value(filter).map_err(|e| Failure::new("filter", e, ""))?;
        let out = Array::new();
        let push = |path: &str, bytes: &[u8]| -> Answer<()> {
            let file = Object::new();
            Reflect::set(&file, &"path".into(), &path.into())?;
            Reflect::set(&file, &"bytes".into(), &Uint8Array::from(bytes))?;
            out.push(&file);
            Ok(())
        };
        for (number, model) in self.models.borrow().iter().enumerate() {
            if component.is_some_and(|wanted| wanted != number) {
                continue;
            }
            let folder = number.to_string();
            let files = export::files(&model.reconstruction, &formats, filter, &folder)
                .map_err(|e| Failure::format(&self.name, &e))?;
            for (path, bytes) in files {
                push(&path, &bytes)?;
            }
        }
        if formats.iter().any(|format| format == "report") {
            if let Some(report) = &*self.report.borrow() {
                let json = serde_json::to_vec_pretty(report).map_err(|e| Failure::new("report", e, ""))?;
                push("report.json", &json)?;
            }
            let settings: serde_json::Value =
                serde_wasm_bindgen::from_value(settings).map_err(|e| Failure::new("settings", e, ""))?;
            let json = serde_json::to_vec_pretty(&settings).map_err(|e| Failure::new("settings", e, ""))?;
            push("settings.json", &json)?;
        }
        Ok(out)
    }

    /// An answer from the model that holds an image, given the image's place in it; nothing where none does.
    fn of_image(&self, image: usize, answer: impl Fn(&Reconstruction, usize) -> Vec<f32>) -> Vec<f32> {
        let models = self.models.borrow();
        let place = models.iter().find_map(|m| m.graph_image.iter().position(|&k| k == image).map(|k| (m, k)));
        place.map_or_else(Vec::new, |(model, k)| answer(&model.reconstruction, k))
    }
}

fn to_js(value: &impl serde::Serialize) -> Answer<JsValue> {
    use serde_wasm_bindgen::Serializer;
    // Maps become plain objects, absent values null: what JSON would give.
    value.serialize(&Serializer::json_compatible()).map_err(|e| JsValue::from_str(&e.to_string()))
}
