//! The depth at a keypoint: bilinear between the four nearest values, refused wherever they do not speak of one surface.

use epipole_geometry::camera::Camera;
use glam::DVec2;
use serde::Serialize;

use super::{DepthKind, DepthMap, DepthOptions, ImageDepths, KeypointDepth, options};

/// Why a keypoint got no depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// It lies outside the map.
    OutsideMap,
    /// One of the values around it is missing, zero, negative, NaN, infinite or a sentinel.
    NoValue,
    /// One of them is larger than [`DepthOptions::max_m`].
    TooFar,
    /// They differ by more than [`DepthOptions::max_jump`].
    Edge,
    /// The map is not sure enough of one of them.
    LowConfidence,
    /// The camera has no ray forward through the pixel, so that a length along it gives no z-depth.
    NoRay,
}

/// How many keypoints got no depth, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RefusalCounts {
    /// [`Refusal::OutsideMap`].
    pub outside_map: usize,
    /// [`Refusal::NoValue`].
    pub no_value: usize,
    /// [`Refusal::TooFar`].
    pub too_far: usize,
    /// [`Refusal::Edge`].
    pub edge: usize,
    /// [`Refusal::LowConfidence`].
    pub low_confidence: usize,
    /// [`Refusal::NoRay`].
    pub no_ray: usize,
}

impl RefusalCounts {
    /// One more.
    pub fn add(&mut self, refusal: Refusal) {
        *match refusal {
            Refusal::OutsideMap => &mut self.outside_map,
            Refusal::NoValue => &mut self.no_value,
            Refusal::TooFar => &mut self.too_far,
            Refusal::Edge => &mut self.edge,
            Refusal::LowConfidence => &mut self.low_confidence,
            Refusal::NoRay => &mut self.no_ray,
        } += 1;
    }
}

/// A depth map laid over the image of a camera: of any resolution, but with the same field of view and distortion.
#[derive(Clone, Debug)]
pub struct DepthSampler<'a> {
    map: &'a DepthMap,
    options: &'a DepthOptions,
    kind: DepthKind,
    camera: &'a Camera,
    /// Pixels of the map per pixel of the image.
    map_from_image: DVec2,
}

impl<'a> DepthSampler<'a> {
    /// Lays a map of the given kind over the images of `camera`.
    pub fn new(map: &'a DepthMap, kind: DepthKind, camera: &'a Camera, options: &'a DepthOptions) -> Self {
        let size = DVec2::new(map.width() as f64, map.height() as f64);
        Self {
            map,
            options,
            kind,
            camera,
            map_from_image: size / DVec2::new(camera.width_px as f64, camera.height_px as f64),
        }
    }

    /// Depths of all keypoints of an image; refusals are added to `refused`.
    pub fn sample_all(&self, keypoints_px: &[DVec2], refused: &mut RefusalCounts) -> ImageDepths {
        let depths = keypoints_px.iter().map(|&px| self.sample(px).map_err(|refusal| refused.add(refusal)).ok());
        ImageDepths::new(depths)
    }

    /// Depth at a position of the image, px.
    ///
    /// The inverse of the z-depth is what is interpolated: on a plane it is a linear function of the pixel, so that a
    /// pinhole camera gets the exact depth of any plane. Within half a pixel of the border the line is prolonged.
    pub fn sample(&self, image_px: DVec2) -> Result<KeypointDepth, Refusal> {
        let px = image_px * self.map_from_image;
        let (width, height) = (self.map.width(), self.map.height());
        // Written so that NaN is outside too.
        if !(px.x >= 0.0 && px.y >= 0.0 && px.x <= width as f64 && px.y <= height as f64) {
            return Err(Refusal::OutsideMap);
        }
        let (columns, fx) = neighbours(px.x, width);
        let (rows, fy) = neighbours(px.y, height);
        self.refuse_edges(columns, rows)?;
        let mut inverse_depth = [0.0; 4];
        let mut confidence = 1.0f64;
        for (k, inverse_depth) in inverse_depth.iter_mut().enumerate() {
            let (column, row) = (columns[k % 2], rows[k / 2]);
            confidence = confidence.min(f64::from(self.map.confidence(column, row)));
            *inverse_depth = 1.0 / self.z_m(column, row)?;
        }
        if confidence < self.options.min_confidence || confidence == 0.0 {
            return Err(Refusal::LowConfidence);
        }
        let [a, b, c, d] = inverse_depth;
        let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
        let z_m = 1.0 / (top + fy * (bottom - top));
        Ok(KeypointDepth { z_m, relative_sigma: options::relative_sigma(self.options, confidence) })
    }

    fn refuse_edges(&self, columns: [usize; 2], rows: [usize; 2]) -> Result<(), Refusal> {
        let margin = self.options.edge_margin_px;
        let span = |[low, high]: [usize; 2], size: usize| low.saturating_sub(margin)..=(high + margin).min(size - 1);
        let (mut least, mut most) = (f64::INFINITY, 0.0f64);
        for row in span(rows, self.map.height()) {
            for column in span(columns, self.map.width()) {
                match self.map.get(column, row).map(f64::from) {
                    Some(value) => (least, most) = (least.min(value), most.max(value)),
                    // Only the four nearest are needed; a hole farther off is no edge.
                    None if columns.contains(&column) && rows.contains(&row) => return Err(Refusal::NoValue),
                    None => {}
                }
            }
        }
        if most > self.options.max_m {
            return Err(Refusal::TooFar);
        }
        if most - least > self.options.max_jump * least {
            return Err(Refusal::Edge);
        }
        Ok(())
    }

    /// The z-depth of a pixel of the map.
    fn z_m(&self, column: usize, row: usize) -> Result<f64, Refusal> {
        let value = f64::from(self.map.get(column, row).ok_or(Refusal::NoValue)?);
        match self.kind {
            DepthKind::Z => Ok(value),
            DepthKind::Ray => {
                let image_px = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) / self.map_from_image;
                let ray = self.camera.ray_from_pixel(image_px).filter(|ray| ray.z > 0.0).ok_or(Refusal::NoRay)?;
                Ok(value * ray.z / ray.length())
            }
        }
    }
}

/// The two pixels whose centres a coordinate lies between, and how far from the first to the second; at the border the
/// two nearest, with a share below 0 or above 1.
fn neighbours(position_px: f64, size: usize) -> ([usize; 2], f64) {
    let from_center = position_px - 0.5;
    let first = (from_center.floor().max(0.0) as usize).min(size.saturating_sub(2));
    if size < 2 {
        return ([0, 0], 0.0);
    }
    ([first, first + 1], from_center - first as f64)
}
