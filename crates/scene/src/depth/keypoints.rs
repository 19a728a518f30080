//! What is known of the depth of an image's keypoints, from a sensor or a learned model.

use glam::DVec2;

/// Depths of all keypoints of an image, those without one included.
///
/// Lies beside the keypoints ([`ViewImage::depths`](crate::ViewImage), [`Image::depths`](crate::Image)) and is shared with
/// them, so that it survives whatever happens to the list of images.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageDepths {
    /// NaN where unknown; otherwise positive and finite.
    z_m: Vec<f32>,
    /// Of the same length; positive and finite where the depth is known.
    relative_sigma: Vec<f32>,
}

/// The measured depth of one keypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeypointDepth {
    /// Distance from the camera's centre along its optical axis, metres; positive.
    pub z_m: f64,
    /// Standard deviation divided by the depth; positive.
    pub relative_sigma: f64,
}

impl KeypointDepth {
    /// The distance from the camera's centre to the point, metres: `z ‖(x̂, ŷ, 1)‖` (solver.md §3.1). Positioning works with
    /// unit rays, so that this, not the z-depth, is what its scales are the inverse of.
    pub fn ray_length_m(&self, normalized: DVec2) -> f64 {
        self.z_m * normalized.extend(1.0).length()
    }
}

impl ImageDepths {
    /// Depths of `num_keypoints` keypoints, none of them known.
    pub fn unknown(num_keypoints: usize) -> Self {
        Self { z_m: vec![f32::NAN; num_keypoints], relative_sigma: vec![f32::NAN; num_keypoints] }
    }

    /// Depths by keypoint, `None` where unknown. A depth or a standard deviation that is not positive and finite counts
    /// as unknown too: nothing can be learned from it.
    pub fn new(by_keypoint: impl IntoIterator<Item = Option<KeypointDepth>>) -> Self {
        let mut depths = Self::default();
        for depth in by_keypoint {
            let (z_m, sigma) = depth.map_or((f32::NAN, f32::NAN), |d| (d.z_m as f32, d.relative_sigma as f32));
            let known = is_measure(z_m) && is_measure(sigma);
            depths.z_m.push(if known { z_m } else { f32::NAN });
            depths.relative_sigma.push(if known { sigma } else { f32::NAN });
        }
        depths
    }

    /// The depth of a keypoint; `None` if it is unknown or there is no such keypoint.
    pub fn get(&self, keypoint: usize) -> Option<KeypointDepth> {
        let z_m = *self.z_m.get(keypoint)?;
        let relative_sigma = *self.relative_sigma.get(keypoint)?;
        (!z_m.is_nan()).then(|| KeypointDepth { z_m: f64::from(z_m), relative_sigma: f64::from(relative_sigma) })
    }

    /// Number of keypoints, those without depth included.
    pub fn len(&self) -> usize {
        self.z_m.len()
    }

    /// Whether there are no keypoints.
    pub fn is_empty(&self) -> bool {
        self.z_m.is_empty()
    }

    /// Number of keypoints with depth.
    pub fn num_known(&self) -> usize {
        self.z_m.iter().filter(|z| !z.is_nan()).count()
    }

    /// All keypoints in order.
    pub fn iter(&self) -> impl Iterator<Item = Option<KeypointDepth>> + '_ {
        (0..self.len()).map(|keypoint| self.get(keypoint))
    }
}

fn is_measure(value: f32) -> bool {
    value > 0.0 && value.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_usable_depths_are_known() {
        let depth = |z_m, relative_sigma| Some(KeypointDepth { z_m, relative_sigma });
        let depths = ImageDepths::new([
            depth(2.0, 0.05),
            None,
            depth(0.0, 0.05),
            depth(-1.0, 0.05),
            depth(f64::NAN, 0.05),
            depth(f64::INFINITY, 0.05),
            depth(1.0, 0.0),
            depth(1.0, f64::NAN),
            depth(1e300, 0.1),
            depth(0.5, 0.125),
        ]);
        assert_eq!((depths.len(), depths.num_known()), (10, 2));
        assert_eq!(depths.get(0).map(|d| d.z_m), Some(2.0));
        assert_eq!(depths.get(9), depth(0.5, 0.125));
        assert!((1..9).chain([10, usize::MAX]).all(|k| depths.get(k).is_none()));
        assert_eq!(ImageDepths::unknown(3).iter().flatten().count(), 0);
    }

    #[test]
    fn the_ray_is_longer_than_the_depth_off_the_axis() {
        let depth = KeypointDepth { z_m: 2.0, relative_sigma: 0.05 };
        assert_eq!(depth.ray_length_m(DVec2::ZERO), 2.0);
        assert_eq!(depth.ray_length_m(DVec2::new(2.0, 2.0)), 6.0);
    }
}
