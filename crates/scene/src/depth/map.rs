//! A depth map in memory, whatever file it came from.

use serde::{Deserialize, Serialize};

/// What the numbers of a depth map measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthKind {
    /// Distance along the optical axis.
    #[default]
    Z,
    /// Distance from the camera's centre.
    Ray,
}

/// Depths on a grid, row by row; the centre of the first pixel is at (0.5, 0.5).
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    width: usize,
    height: usize,
    /// Metres; NaN where unknown, otherwise positive and finite.
    values_m: Vec<f32>,
    /// Between 0 and 1, one a pixel, if the map has confidences.
    confidence: Option<Vec<f32>>,
}

impl DepthMap {
    /// A map of `height` rows of `width` values in metres; zero, negative, NaN and infinite ones count as unknown.
    /// `None` if the number of values is not `width · height` or the map has no pixels.
    pub fn new(width: usize, height: usize, mut values_m: Vec<f32>) -> Option<Self> {
        if values_m.is_empty() || width.checked_mul(height) != Some(values_m.len()) {
            return None;
        }
        for value in &mut values_m {
            if !(*value > 0.0 && value.is_finite()) {
                *value = f32::NAN;
            }
        }
        Some(Self { width, height, values_m, confidence: None })
    }

    /// The map with a confidence for every pixel, 0 (none) to 1 (full); NaN counts as 0. `None` if their number differs.
    pub fn with_confidence(self, mut confidence: Vec<f32>) -> Option<Self> {
        for value in &mut confidence {
            *value = if *value > 0.0 { value.min(1.0) } else { 0.0 };
        }
        if confidence.len() != self.values_m.len() {
            return None;
        }
        Some(Self { confidence: Some(confidence), ..self })
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All values row by row, metres; NaN where unknown.
    pub fn values_m(&self) -> &[f32] {
        &self.values_m
    }

    /// The value of a pixel, metres. `None` where it is unknown or there is no such pixel.
    pub fn get(&self, column: usize, row: usize) -> Option<f32> {
        if column >= self.width {
            return None;
        }
        self.values_m.get(row.checked_mul(self.width)? + column).copied().filter(|value| !value.is_nan())
    }

    /// Whether pixels have confidences.
    pub fn has_confidence(&self) -> bool {
        self.confidence.is_some()
    }

    /// The confidence of a pixel of the map; 1 if there are none.
    pub(super) fn confidence(&self, column: usize, row: usize) -> f32 {
        let index = row * self.width + column;
        self.confidence.as_ref().map_or(1.0, |c| c.get(index).copied().unwrap_or(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_depth_is_unknown() {
        let map = DepthMap::new(3, 2, vec![1.0, 0.0, -2.0, f32::NAN, f32::INFINITY, 0.5]).expect("six values");
        assert_eq!((map.get(0, 0), map.get(2, 1)), (Some(1.0), Some(0.5)));
        assert!(
            [(1, 0), (2, 0), (0, 1), (1, 1), (3, 0), (0, 2), (usize::MAX, 0), (0, usize::MAX)]
                .iter()
                .all(|&(column, row)| map.get(column, row).is_none())
        );
        assert!(DepthMap::new(3, 2, vec![1.0; 5]).is_none() && DepthMap::new(0, 0, Vec::new()).is_none());
        assert!(DepthMap::new(usize::MAX, 2, vec![1.0; 5]).is_none());
        let sure = map.with_confidence(vec![2.0, 0.5, f32::NAN, -1.0, 0.0, 1.0]).expect("six confidences");
        assert_eq!([0, 1, 2].map(|c| sure.confidence(c, 0)), [1.0, 0.5, 0.0]);
        assert!(sure.with_confidence(vec![1.0]).is_none());
    }
}
