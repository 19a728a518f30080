//! What an image can see: how deep a point must lie, and where its pixel may fall.

use epipole_geometry::camera::CameraFamily;

use super::problem::Problem;
use crate::active::{Activation, MIN_RELATIVE_DEPTH};
use crate::grouping::group;

/// The frustum is this much wider and higher than the image (source: `solver.md` §5.4).
const MARGIN: f64 = 1.2;

/// The frusta of a problem's images, fixed for a solve so that the objective is one function.
#[derive(Clone, Debug)]
pub(super) struct Frusta {
    /// Depth that a point must exceed, by image; `None` where depth does not matter.
    least_depth: Vec<Option<f64>>,
    /// Lowest x and y, highest x and y by image, px.
    bounds_px: Vec<[f64; 4]>,
}

impl Frusta {
    /// Depths from the start: 0 where the set of observations is that of the start, else a share of the image's median.
    pub(super) fn new(problem: &Problem, activation: Activation) -> Self {
        Self { least_depth: least_depths(problem, activation), bounds_px: bounds(problem) }
    }

    #[inline(always)]
    pub(super) fn least_depth(&self, image: usize) -> Option<f64> {
        self.least_depth[image]
    }

    /// Lowest x and y, highest x and y, px.
    #[cfg(feature = "gpu")]
    pub(super) fn bounds_px(&self, image: usize) -> [f64; 4] {
        self.bounds_px[image]
    }

    /// Whether a projection is near enough to the image.
    #[inline(always)]
    pub(super) fn contains(&self, image: usize, px: [f64; 2]) -> bool {
        let [left, top, right, bottom] = self.bounds_px[image];
        (left..=right).contains(&px[0]) && (top..=bottom).contains(&px[1])
    }
}

fn least_depths(problem: &Problem, activation: Activation) -> Vec<Option<f64>> {
    let has_depth = |i: usize| {
        let camera = &problem.cameras[problem.image_camera[i] as usize];
        activation != Activation::All && camera.model.family() != CameraFamily::Spherical
    };
    let images = problem.cam_from_world.len();
    if matches!(activation, Activation::All | Activation::ValidAtStart) {
        return (0..images).map(|i| has_depth(i).then_some(0.0)).collect();
    }
    let tracks = problem.track_start.windows(2).enumerate();
    let point_of: Vec<usize> = tracks.flat_map(|(p, track)| (track[0]..track[1]).map(move |_| p)).collect();
    let (start, order) = group(&problem.observation_image, images);
    let mut depths = Vec::new();
    let median = |i: usize| {
        depths.clear();
        let pose = &problem.cam_from_world[i];
        let points = order[start[i] as usize..start[i + 1] as usize].iter().map(|&o| point_of[o as usize]);
        depths.extend(points.map(|p| pose.transform_point(problem.points[p]).z).filter(|z| *z > 0.0));
        let middle = depths.len() / 2;
        if depths.is_empty() { 0.0 } else { *depths.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let share = |(i, median): (usize, f64)| has_depth(i).then_some(MIN_RELATIVE_DEPTH * median);
    (0..images).map(median).enumerate().map(share).collect()
}

/// The rectangle of the image and of all that was observed in it (pixels of some formats are counted from the middle),
/// widened.
fn bounds(problem: &Problem) -> Vec<[f64; 4]> {
    let size = |&c: &u32| {
        let camera = &problem.cameras[c as usize];
        [0.0, 0.0, camera.width_px as f64, camera.height_px as f64]
    };
    let mut bounds: Vec<[f64; 4]> = problem.image_camera.iter().map(size).collect();
    for (&i, px) in problem.observation_image.iter().zip(&problem.observation_px) {
        let b = &mut bounds[i as usize];
        *b = [b[0].min(px.x), b[1].min(px.y), b[2].max(px.x), b[3].max(px.y)];
    }
    for b in &mut bounds {
        let margin = [b[2] - b[0], b[3] - b[1]].map(|length| 0.5 * (MARGIN - 1.0) * length);
        *b = [b[0] - margin[0], b[1] - margin[1], b[2] + margin[0], b[3] + margin[1]];
    }
    bounds
}

#[cfg(test)]
mod tests {
    use epipole_geometry::Rigid3;
    use epipole_geometry::camera::{Camera, CameraModel};
    use glam::{DVec2, DVec3};

    use super::*;

    #[test]
    fn depth_is_relative_and_the_image_has_a_margin() {
        let problem = Problem {
            cam_from_world: vec![Rigid3::IDENTITY],
            image_camera: vec![0],
            cameras: vec![Camera::with_default_params(0, CameraModel::Pinhole, 100, 200)],
            points: [-3.0, 1.0, 20.0, 400.0].map(|z| DVec3::new(0.0, 0.0, z)).to_vec(),
            track_start: vec![0, 1, 2, 3, 4],
            observation_image: vec![0; 4],
            observation_px: vec![DVec2::splat(50.0); 4],
            ..Problem::default()
        };
        let depth = |activation| Frusta::new(&problem, activation).least_depth(0);
        assert_eq!(depth(Activation::DYNAMIC), Some(0.05 * 20.0));
        assert_eq!((depth(Activation::ValidAtStart), depth(Activation::All)), (Some(0.0), None));
        let frusta = Frusta::new(&problem, Activation::DYNAMIC);
        assert!(frusta.contains(0, [-9.0, 219.0]) && !frusta.contains(0, [-11.0, 0.0]));
        assert!(!frusta.contains(0, [f64::NAN, 0.0]));
    }
}
