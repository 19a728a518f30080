//! Matches of a watermark, a time stamp or a frame: a pure shift near the image border, not the scene.

use glam::DVec2;

use crate::camera::Camera;

/// When a pair counts as a watermark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WatermarkOptions {
    /// Width of the border, as a share of the image diagonal.
    pub border_ratio: f64,
    /// Share of the inliers that must lie in the border of both images and agree on the shift.
    pub min_inlier_ratio: f64,
    /// Largest departure from the common shift, px.
    pub max_error_px: f64,
}

impl Default for WatermarkOptions {
    /// COLMAP's values (`algorithms.md` §2.2).
    fn default() -> Self {
        Self { border_ratio: 0.1, min_inlier_ratio: 0.7, max_error_px: 4.0 }
    }
}

/// Candidate shifts tried. If 70 % of the matches agree, the chance that 32 evenly spread ones all disagree is 1e-17.
const MAX_CANDIDATES: usize = 32;

/// Whether most of the inliers (`points1[i]` with `points2[i]`, px) are a shift of the border.
pub fn is_watermark(
    camera1: &Camera,
    points1: &[DVec2],
    camera2: &Camera,
    points2: &[DVec2],
    options: &WatermarkOptions,
) -> bool {
    let total = points1.len().min(points2.len());
    if total == 0 {
        return false;
    }
    let shifts: Vec<DVec2> = points1
        .iter()
        .zip(points2)
        .filter(|&(&p, &q)| in_border(camera1, p, options.border_ratio) && in_border(camera2, q, options.border_ratio))
        .map(|(p, q)| *q - *p)
        .collect();
    let wanted = options.min_inlier_ratio * total as f64;
    if (shifts.len() as f64) < wanted || shifts.is_empty() {
        return false;
    }
    let stride = shifts.len().div_ceil(MAX_CANDIDATES);
    shifts.iter().step_by(stride).any(|candidate| {
        let agreeing = shifts.iter().filter(|s| s.distance(*candidate) <= options.max_error_px).count();
        agreeing as f64 >= wanted
    })
}

fn in_border(camera: &Camera, point: DVec2, border_ratio: f64) -> bool {
    let size = DVec2::new(camera.width_px as f64, camera.height_px as f64);
    let border = DVec2::splat(border_ratio * size.length());
    point.cmplt(border).any() || point.cmpgt(size - border).any()
}
