//! One scene: opened, solved, asked about, exported.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

use epipole_formats::{FormatWarning, read_model_files};
use epipole_mapper::Report;
use epipole_scene::statistics::update_point_errors;
use epipole_scene::{Reconstruction, ViewGraph};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};
use web_sys::File;

use crate::bytes::TabFile;
use crate::control::{Control, Wishes};
use crate::deafness::Deafness;
use crate::depths::DepthMaps;
use crate::error::Failure;
use crate::memory::predicted_bytes;
use crate::opened;
use crate::pictures::Pictures;
use crate::source::Source;

/// A reconstruction and where its images stand among all that were opened.
pub(crate) struct Model {
    pub(crate) reconstruction: Reconstruction,
    pub(crate) graph_image: Vec<usize>,
}

/// What the worker holds of a scene. A run only borrows it, so that the page can ask about images while it waits: what a
/// run changes is in cells, and none is borrowed across a breath.
#[wasm_bindgen]
pub struct Session {
    pub(crate) name: String,
    pub(crate) graph: Option<ViewGraph>,
    /// Where the graph is from, and what was said of it when it was opened.
    pub(crate) source: Option<(Source, Vec<String>)>,
    pub(crate) models: RefCell<Vec<Model>>,
    pub(crate) pictures: Pictures,
    pub(crate) depths: DepthMaps,
    pub(crate) report: RefCell<Option<Report>>,
    pub(crate) wishes: Wishes,
    pub(crate) deafness: Deafness,
}

pub(crate) type Answer<T> = Result<T, JsValue>;

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
            source: None,
            models: RefCell::default(),
            pictures: Pictures::default(),
            depths: DepthMaps::default(),
            report: RefCell::default(),
            wishes: Wishes::default(),
            deafness: Deafness::default(),
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
        let wal = wal.map(|wal| tab_file(path, wal).map(Rc::new)).transpose()?;
        let source = Source { path: path.to_owned(), database, wal };
        let (graph, warnings) = source.read(false)?;
        let predicted = predicted_bytes(&graph);
        let answer = opened::graph(base(path), &graph, warnings.clone(), bytes, predicted)?;
        self.name = base(path).to_owned();
        self.graph = Some(graph);
        self.source = Some((source, warnings));
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
        let mut loaded = read_model_files(Path::new(folder), &read).map_err(|e| Failure::format(folder, &e))?;
        // The files may have been written by anybody: the errors are those of this model.
        update_point_errors(&mut loaded.value);
        let answer = opened::model(folder, &loaded.value, texts(&loaded.warnings), bytes)?;
        let graph_image = (0..loaded.value.images.len()).collect();
        self.name = folder.to_owned();
        self.models = RefCell::new(vec![Model { reconstruction: loaded.value, graph_image }]);
        Ok(answer)
    }

    /// Photographs by image name, for colours.
    #[wasm_bindgen(js_name = addPicture)]
    pub fn add_picture(&self, name: &str, file: File) {
        self.pictures.add(name.to_owned(), file);
    }

    /// Depth maps and confidences by their paths, and `depth.json`; the next run finds whose they are.
    #[wasm_bindgen(js_name = addDepth)]
    pub fn add_depth(&self, path: &str, file: File) -> Answer<()> {
        self.depths.add(path.to_owned(), tab_file(path, file)?);
        Ok(())
    }

    /// The longest time for which the last run did not look at what it was asked, ms, and its stage.
    #[wasm_bindgen(js_name = longestGap)]
    pub fn longest_gap(&self) -> Answer<JsValue> {
        #[derive(serde::Serialize)]
        struct Gap {
            ms: f64,
            stage: Option<epipole_mapper::Stage>,
        }
        let (seconds, stage) = self.deafness.longest();
        to_js(&Gap { ms: 1e3 * seconds, stage })
    }
}

pub(crate) fn to_js(value: &impl serde::Serialize) -> Answer<JsValue> {
    use serde_wasm_bindgen::Serializer;
    // Maps become plain objects, absent values null: what JSON would give.
    value.serialize(&Serializer::json_compatible()).map_err(|e| JsValue::from_str(&e.to_string()))
}
