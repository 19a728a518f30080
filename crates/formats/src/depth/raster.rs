//! Numbers on a grid as a file holds them, before anyone says what they measure.

use epipole_scene::depth::DepthMap;

use crate::error::Problem;

/// Largest map that is read, pixels: 8192 on a side.
pub(super) const MAX_PIXELS: u64 = 1 << 26;

/// No compression here packs better: deflate reaches 1032 : 1, LZW 1365 : 1, and no map is all one value. It bounds what a
/// header can make us reserve.
const MAX_EXPANSION: u64 = 1 << 14;

/// Metres a unit of whole numbers: sensors count millimetres.
const DEFAULT_INTEGER_SCALE: f64 = 0.001;

/// A grid of numbers, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Raster {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
    /// For whole numbers, the largest that the file's type can hold.
    pub(crate) full_scale: Option<f32>,
}

impl Raster {
    /// The grid as depths. Zero and, for whole numbers, the largest possible one mean that there is no value.
    pub(crate) fn into_depths(mut self, scale: Option<f64>) -> Result<DepthMap, Problem> {
        // A picture of a depth map: 255 steps are too few to measure with.
        if self.full_scale == Some(f32::from(u8::MAX)) {
            return Err(Problem::WrongKind {
                expected: "a depth map",
                reason: "it has 8 bits a pixel; a picture of a depth map holds no depths".into(),
            });
        }
        let scale = scale.unwrap_or(if self.full_scale.is_some() { DEFAULT_INTEGER_SCALE } else { 1.0 });
        let sentinel = self.full_scale;
        for value in &mut self.values {
            *value = if sentinel == Some(*value) { f32::NAN } else { (f64::from(*value) * scale) as f32 };
        }
        DepthMap::new(self.width, self.height, self.values).ok_or(Problem::Empty)
    }

    /// The grid as confidences between 0 and 1: whole numbers are shares of `full` or of the largest one of their type,
    /// floating-point numbers shares of `full` or what they are.
    pub(crate) fn into_confidences(self, full: Option<f64>) -> Vec<f32> {
        let full = full.or(self.full_scale.map(f64::from)).unwrap_or(1.0);
        self.values.into_iter().map(|value| (f64::from(value) / full) as f32).collect()
    }
}

/// Checks what a header says of the size before anything is reserved; `available` bytes hold the whole, compressed or not.
/// Returns the number of pixels.
pub(crate) fn check_size(width: u64, height: u64, bytes_per_pixel: u64, available: u64) -> Result<usize, Problem> {
    let pixels = width.saturating_mul(height);
    if pixels == 0 {
        return Err(Problem::Empty);
    }
    if pixels > MAX_PIXELS {
        return Err(Problem::OutOfRange {
            what: "the size".into(),
            found: format!("{width} × {height}"),
            expected: format!("at most {MAX_PIXELS} pixels"),
        });
    }
    let expected = pixels.saturating_mul(bytes_per_pixel);
    if expected / MAX_EXPANSION > available {
        return Err(Problem::Truncated { expected: expected / MAX_EXPANSION, found: available });
    }
    Ok(pixels as usize)
}
