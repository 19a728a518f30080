//! A grid of cameras before a nearly flat wall: the case where a homography explains most of a pair.

use glam::DVec3;

use super::{Layout, WorldPoint, look_at, tint};
use crate::synth::options::Options;
use crate::synth::random::Random;

/// Metres between columns and between rows of cameras.
const SPACING: [f64; 2] = [1.8, 1.4];
/// Metres from the wall.
const DISTANCE: f64 = 8.0;

pub(super) fn build(options: &Options, random: &mut Random) -> Layout {
    let n = options.num_images;
    let columns = ((2 * n) as f64).sqrt().ceil().max(1.0) as usize;
    let rows = n.div_ceil(columns).max(1);
    let (width, height) = (SPACING[0] * columns as f64, SPACING[1] * rows as f64);
    let cam_from_world = (0..n).map(|i| {
        let (column, row) = ((i % columns) as f64, (i / columns) as f64);
        let center = DVec3::new(
            SPACING[0] * (column + random.uniform(-0.2, 0.2)),
            -DISTANCE + random.uniform(-1.0, 1.0),
            1.5 + SPACING[1] * (row + random.uniform(-0.2, 0.2)),
        );
        let target = DVec3::new(center.x + random.gaussian() * 1.2, 0.0, center.z + random.gaussian() * 0.6);
        look_at(center, target, random.gaussian() * 0.03)
    });
    let cam_from_world: Vec<_> = cam_from_world.collect();
    let points = (0..options.num_points).map(|_| {
        let (x, z) = (random.uniform(-4.0, width + 4.0), random.uniform(-2.0, height + 5.0));
        // Window panes lie behind the wall, balconies stand before it.
        let relief = match random.unit() {
            u if u < 0.2 => 0.35,
            u if u < 0.35 => random.uniform(-1.2, -0.3),
            _ => random.uniform(-0.04, 0.04),
        };
        WorldPoint {
            position: DVec3::new(x, relief, z),
            normal: DVec3::NEG_Y,
            rgb: tint(random, [190, 180, 150]),
            popularity: 1.0,
        }
    });
    Layout { cam_from_world, zoom: vec![1.0; n], points: points.collect(), max_distance: 40.0 }
}
