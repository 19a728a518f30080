//! A drive along a row of houses, straight or around a block.

use glam::DVec3;

use super::{Layout, WorldPoint, look_at, tint};
use crate::synth::options::Options;
use crate::synth::random::Random;

/// Metres between photographs.
const SPACING: f64 = 1.5;
/// Metres from the path to the houses.
const HOUSE_DISTANCE: f64 = 8.0;
/// Width of a house, metres.
const HOUSE_WIDTH: f64 = 7.0;

/// The path: a straight line along +X, or a circle driven counter-clockwise.
struct Path {
    length: f64,
    closed: bool,
}

/// A place on the path: origin, heading and the side on which the houses stand.
struct Place {
    origin: DVec3,
    heading: DVec3,
    right: DVec3,
}

impl Path {
    fn at(&self, metres: f64) -> Place {
        if !self.closed {
            return Place { origin: DVec3::X * metres, heading: DVec3::X, right: DVec3::NEG_Y };
        }
        let radius = self.length / std::f64::consts::TAU;
        let (sin, cos) = (metres / radius).sin_cos();
        let right = DVec3::new(cos, sin, 0.0);
        Place { origin: right * radius, heading: DVec3::new(-sin, cos, 0.0), right }
    }
}

pub(super) fn build(options: &Options, random: &mut Random) -> Layout {
    let n = options.num_images;
    let path = Path { length: SPACING * n.max(1) as f64, closed: options.loop_closure };
    let cam_from_world = (0..n).map(|i| {
        let place = path.at(SPACING * (i as f64 + random.uniform(-0.1, 0.1)));
        let center =
            place.origin + DVec3::Z * (1.6 + random.uniform(-0.1, 0.1)) + place.right * random.gaussian() * 0.1;
        // 60° from the heading: sideways enough for parallax, forward enough for long tracks.
        let yaw = (60.0 + random.gaussian() * 3.0).to_radians();
        let direction = place.heading * yaw.cos() + place.right * yaw.sin() + DVec3::Z * random.uniform(0.05, 0.15);
        look_at(center, center + direction, random.gaussian() * 0.02)
    });
    let cam_from_world: Vec<_> = cam_from_world.collect();
    // An open street goes on for a view's length past both ends.
    let (start, end) = if path.closed { (0.0, path.length) } else { (-5.0, path.length + 15.0) };
    let points = (0..options.num_points).map(|_| {
        let metres = random.uniform(start, end);
        if random.chance(0.8) { house(&path, metres, random) } else { pavement(&path, metres, random) }
    });
    Layout { cam_from_world, zoom: vec![1.0; n], points: points.collect(), max_distance: 25.0 }
}

fn house(path: &Path, metres: f64, random: &mut Random) -> WorldPoint {
    let place = path.at(metres);
    // Neighbouring houses stand at different depths; the golden ratio keeps the row from repeating.
    let number = (metres / HOUSE_WIDTH).floor();
    let setback = 3.0 * (number * 0.618_033_988_749_895).rem_euclid(1.0);
    let distance = HOUSE_DISTANCE + setback + random.uniform(-0.25, 0.25);
    WorldPoint {
        position: place.origin + place.right * distance + DVec3::Z * random.uniform(0.2, 8.0),
        normal: -place.right,
        rgb: tint(random, [180, 160, 140]),
        popularity: 1.0,
    }
}

fn pavement(path: &Path, metres: f64, random: &mut Random) -> WorldPoint {
    let place = path.at(metres);
    // Parked cars and street furniture: what gives near depth.
    WorldPoint {
        position: place.origin + place.right * random.uniform(3.5, 7.0) + DVec3::Z * random.uniform(0.0, 1.5),
        normal: -place.right,
        rgb: tint(random, [110, 120, 130]),
        popularity: 1.0,
    }
}
