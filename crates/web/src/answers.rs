//! What the page asks of a session, also while a run goes on.

use epipole_scene::Reconstruction;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use crate::query;
use crate::session::{Answer, Session, to_js};
use crate::snapshot::Arrays;

#[wasm_bindgen]
impl Session {
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

    /// Verified matches, or the common points of a model, five numbers each: x, y here, x, y there, 1.
    pub fn matches(&self, image: usize, other: usize) -> Vec<f32> {
        match &self.graph {
            Some(graph) if image.max(other) < graph.images.len() => query::matches(graph, image, other),
            Some(_) => Vec::new(),
            None => self.of_image(image, |model, _| query::common_points(model, image, other)),
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

    /// An answer from the model that holds an image, given the image's place in it; nothing where none does.
    fn of_image(&self, image: usize, answer: impl Fn(&Reconstruction, usize) -> Vec<f32>) -> Vec<f32> {
        let models = self.models.borrow();
        let place = models.iter().find_map(|m| m.graph_image.iter().position(|&k| k == image).map(|k| (m, k)));
        place.map_or_else(Vec::new, |(model, k)| answer(&model.reconstruction, k))
    }
}
