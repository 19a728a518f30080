//! A ring of cameras around a bumpy object on a table.

use glam::DVec3;

use super::{Layout, WorldPoint, look_at, tint};
use crate::synth::options::Options;
use crate::synth::random::Random;

/// Distance of the cameras from the object's middle: it then fills most of the image at the typical focal length.
const RING_RADIUS: f64 = 3.2;

pub(super) fn build(options: &Options, random: &mut Random) -> Layout {
    let n = options.num_images;
    let cam_from_world = (0..n).map(|i| {
        let angle = std::f64::consts::TAU * (i as f64 + random.uniform(-0.2, 0.2)) / n.max(1) as f64;
        let height = 0.8 + 0.5 * (2.0 * angle).sin() + random.uniform(-0.1, 0.1);
        let radius = RING_RADIUS * random.uniform(0.92, 1.08);
        let center = DVec3::new(radius * angle.cos(), radius * angle.sin(), height);
        look_at(center, random.gaussian3(0.1), random.uniform(-0.08, 0.08))
    });
    let cam_from_world: Vec<_> = cam_from_world.collect();
    let points = (0..options.num_points).map(|_| if random.chance(0.7) { object(random) } else { table(random) });
    Layout { cam_from_world, zoom: vec![1.0; n], points: points.collect(), max_distance: 10.0 }
}

fn object(random: &mut Random) -> WorldPoint {
    let direction = random.direction();
    let (azimuth, elevation) = (direction.y.atan2(direction.x), direction.z.asin());
    let radius = 1.0 + 0.2 * (3.0 * azimuth).sin() * (2.0 * elevation).cos() + random.uniform(-0.03, 0.03);
    WorldPoint { position: direction * radius, normal: direction, rgb: tint(random, [170, 120, 80]), popularity: 1.0 }
}

fn table(random: &mut Random) -> WorldPoint {
    // Uniform on the ring of radii 0.9 to 2.2 m around the object's foot.
    let radius = random.uniform(0.9f64.powi(2), 2.2f64.powi(2)).sqrt();
    let angle = random.uniform(0.0, std::f64::consts::TAU);
    WorldPoint {
        position: DVec3::new(radius * angle.cos(), radius * angle.sin(), -0.9 + random.uniform(-0.02, 0.02)),
        normal: DVec3::Z,
        rgb: tint(random, [90, 100, 120]),
        popularity: 1.0,
    }
}
