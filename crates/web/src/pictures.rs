//! Photographs for colours, decoded by the browser one at a time.

use std::cell::RefCell;
use std::collections::BTreeMap;

use epipole_mapper::stages::finish::{ImageSource, Loading};
use image::RgbImage;
use js_sys::{Reflect, Uint8Array};
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::File;

use crate::host::Host;

/// Photographs are made no larger than this: points take one pixel of them, and an image of 50 megapixels would double
/// the memory of a run.
const MAX_SIDE_PX: u32 = 2048;

/// Files by image name. They may come while a run is on its way.
#[derive(Default)]
pub(crate) struct Pictures(RefCell<BTreeMap<String, File>>);

impl Pictures {
    pub(crate) fn add(&self, name: String, file: File) {
        self.0.borrow_mut().insert(name, file);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.borrow().is_empty()
    }

    fn get(&self, name: &str) -> Option<File> {
        self.0.borrow().get(name).cloned()
    }
}

/// Photographs with whoever decodes them.
pub(crate) struct Decoded<'a> {
    pub(crate) pictures: &'a Pictures,
    pub(crate) host: Host,
}

impl ImageSource for Decoded<'_> {
    fn load<'a>(&'a mut self, name: &'a str) -> Loading<'a> {
        Box::pin(async move {
            let promise = self.host.decode(&self.pictures.get(name)?, MAX_SIDE_PX).ok()?;
            rgb(&JsFuture::from(promise).await.ok()?)
        })
    }
}

fn rgb(image: &JsValue) -> Option<RgbImage> {
    let get = |name: &str| Reflect::get(image, &name.into()).ok();
    let (width, height) = (get("width")?.as_f64()? as u32, get("height")?.as_f64()? as u32);
    let data: js_sys::Uint8ClampedArray = get("data")?.dyn_into().ok()?;
    let rgba = Uint8Array::new(&data.buffer()).to_vec();
    RgbImage::from_vec(width, height, rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect())
}
