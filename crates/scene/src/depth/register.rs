//! A depth map as another camera would see it: every cell of four neighbouring pixels becomes two triangles, which are
//! drawn into the other image with a depth buffer.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::Camera;
use glam::{DVec2, DVec3};

use super::{DepthKind, DepthMap};

/// Largest image that is drawn, pixels; a larger one is a mistake in a camera.
const MAX_PIXELS: u64 = 1 << 26;

/// Sides of the box around a triangle, pixels. Neighbouring pixels of one surface stay neighbours in a camera nearby;
/// a triangle larger than this comes from values next to the camera's centre.
const MAX_TRIANGLE_PX: f64 = 32.0;

/// How far beyond its sides a triangle is drawn, as a share of it: rounding must not leave seams.
const SEAM: f64 = 1e-9;

/// Why a map cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RegisterError {
    /// The other image has no pixels or far too many.
    #[error("an image of {width_px} × {height_px} pixels is not drawn; at most {MAX_PIXELS} pixels are")]
    Size {
        /// Width of the other image.
        width_px: u64,
        /// Height of the other image.
        height_px: u64,
    },
}

/// One pixel of the map on the other image.
#[derive(Clone, Copy)]
struct Vertex {
    /// Pixel of the drawn map.
    px: DVec2,
    /// Inverse z-depth in the other camera.
    inverse_z: f64,
    /// The map's own value, for telling edges.
    value_m: f64,
    confidence: f64,
}

/// Draws `map`, taken by `depth_camera`, as `color_camera` sees it from `color_from_depth`. The result holds z-depths and has
/// the field of view and distortion of `color_camera`; its resolution is that of the colour image or, where the map is
/// coarser, the map's. Cells whose values differ by more than `max_jump` (relative) are edges of objects and stay open.
///
/// # Errors
/// [`RegisterError`] when the size of the colour camera's image is impossible.
pub fn register(
    map: &DepthMap,
    kind: DepthKind,
    depth_camera: &Camera,
    color_from_depth: &Rigid3,
    color_camera: &Camera,
    max_jump: f64,
) -> Result<DepthMap, RegisterError> {
    let size = DVec2::new(map.width() as f64, map.height() as f64);
    let depth_px_from_map =
        DVec2::new(depth_camera.width_px as f64, depth_camera.height_px as f64) / size.max(DVec2::ONE);
    // As many pixels a degree as the map has, but no more than the colour image.
    let map_focal_px = depth_camera.mean_focal_px() / depth_px_from_map.max_element();
    let shrink = (map_focal_px / color_camera.mean_focal_px()).clamp(0.0, 1.0);
    let side = |px: u64| ((px as f64 * shrink).round() as u64).clamp(1, px.max(1));
    let (width, height) = (side(color_camera.width_px), side(color_camera.height_px));
    let impossible = RegisterError::Size { width_px: color_camera.width_px, height_px: color_camera.height_px };
    if color_camera.width_px == 0 || color_camera.height_px == 0 || width.saturating_mul(height) > MAX_PIXELS {
        return Err(impossible);
    }
    let drawn_from_color =
        DVec2::new(width as f64 / color_camera.width_px as f64, height as f64 / color_camera.height_px as f64);
    let vertex = |column: usize, row: usize| -> Option<Vertex> {
        let value_m = f64::from(map.get(column, row)?);
        let center_px = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * depth_px_from_map;
        let ray = depth_camera.ray_from_pixel(center_px).filter(|ray| ray.z > 0.0)?;
        let in_depth: DVec3 = match kind {
            DepthKind::Z => ray * (value_m / ray.z),
            DepthKind::Ray => ray * (value_m / ray.length()),
        };
        let in_color = color_from_depth.transform_point(in_depth);
        let px = color_camera.project(in_color).filter(|_| in_color.z > 0.0)? * drawn_from_color;
        let confidence = f64::from(map.confidence(column, row));
        Some(Vertex { px, inverse_z: 1.0 / in_color.z, value_m, confidence })
    };
    let mut canvas = Canvas::new(width as usize, height as usize);
    let row_of = |row: usize| -> Vec<Option<Vertex>> { (0..map.width()).map(|column| vertex(column, row)).collect() };
    let mut above = row_of(0);
    for row in 1..map.height() {
        let below = row_of(row);
        for (above, below) in above.windows(2).zip(below.windows(2)) {
            if let ([Some(a), Some(b)], [Some(c), Some(d)]) = (above, below)
                && is_one_surface([a, b, c, d], max_jump)
            {
                canvas.draw([a, b, c]);
                canvas.draw([b, d, c]);
            }
        }
        above = below;
    }
    canvas.finish(map.has_confidence()).ok_or(impossible)
}

fn is_one_surface(cell: [&Vertex; 4], max_jump: f64) -> bool {
    let least = cell.iter().map(|v| v.value_m).fold(f64::INFINITY, f64::min);
    let most = cell.iter().map(|v| v.value_m).fold(0.0, f64::max);
    most - least <= max_jump * least
}

/// The image being drawn: the largest inverse depth wins.
struct Canvas {
    width: usize,
    height: usize,
    inverse_z: Vec<f32>,
    confidence: Vec<f32>,
}

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, inverse_z: vec![0.0; width * height], confidence: vec![0.0; width * height] }
    }

    /// Fills the pixels whose centres lie in a triangle. The inverse depth of a plane is linear in the pixel.
    fn draw(&mut self, [a, b, c]: [&Vertex; 3]) {
        let low = a.px.min(b.px).min(c.px);
        let high = a.px.max(b.px).max(c.px);
        let area = (b.px - a.px).perp_dot(c.px - a.px);
        let (extent, is_finite) = ((high - low).max_element(), low.is_finite() && high.is_finite());
        if !is_finite || extent > MAX_TRIANGLE_PX || area == 0.0 {
            return;
        }
        let confidence = a.confidence.min(b.confidence).min(c.confidence);
        // Pixels whose centres are within the box: from ⌈low − ½⌉ to ⌊high − ½⌋.
        let span = |low: f64, high: f64, size: usize| {
            (low - 0.5).ceil().max(0.0) as usize..((high - 0.5).floor() + 1.0).clamp(0.0, size as f64) as usize
        };
        for row in span(low.y, high.y, self.height) {
            for column in span(low.x, high.x, self.width) {
                let p = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) - a.px;
                let share_b = p.perp_dot(c.px - a.px) / area;
                let share_c = (b.px - a.px).perp_dot(p) / area;
                if share_b.min(share_c).min(1.0 - share_b - share_c) < -SEAM {
                    continue;
                }
                let inverse_z =
                    a.inverse_z + share_b * (b.inverse_z - a.inverse_z) + share_c * (c.inverse_z - a.inverse_z);
                let pixel = row * self.width + column;
                if inverse_z as f32 > self.inverse_z[pixel] {
                    self.inverse_z[pixel] = inverse_z as f32;
                    self.confidence[pixel] = confidence as f32;
                }
            }
        }
    }

    /// Pixels that nothing was drawn on have an infinite depth, which the map takes for unknown.
    fn finish(self, with_confidence: bool) -> Option<DepthMap> {
        let values_m = self.inverse_z.iter().map(|inverse| 1.0 / inverse).collect();
        let map = DepthMap::new(self.width, self.height, values_m)?;
        if with_confidence { map.with_confidence(self.confidence) } else { Some(map) }
    }
}
