//! Strangers' photographs of one building: a few popular viewpoints, many lenses, and points few of them share.

use glam::DVec3;

use super::{Layout, WorldPoint, look_at, tint};
use crate::synth::options::Options;
use crate::synth::random::Random;

/// Half the building's width, its depth and height, metres.
const HALF_WIDTH: f64 = 15.0;
const DEPTH: f64 = 20.0;
const HEIGHT: f64 = 18.0;
/// Tail index of the points' popularity; photo collections have between 1 and 2 (track lengths of 1DSfM's scenes).
const POPULARITY_TAIL: f64 = 1.3;

/// A place where many people stand.
struct Hub {
    center: DVec3,
    popularity: f64,
}

pub(super) fn build(options: &Options, random: &mut Random) -> Layout {
    let n = options.num_images;
    let hubs = hubs(n, random);
    let (mut cam_from_world, mut zoom) = (Vec::with_capacity(n), Vec::with_capacity(n));
    let total: f64 = hubs.iter().map(|hub| hub.popularity).sum();
    for _ in 0..n {
        let mut left = random.unit() * total;
        let hub = hubs.iter().find(|hub| {
            left -= hub.popularity;
            left < 0.0
        });
        let hub = hub.unwrap_or(&hubs[0]);
        let step = DVec3::new(random.gaussian(), random.gaussian(), 0.0) * 2.0;
        let center = hub.center + step + DVec3::Z * random.uniform(-0.2, 0.4);
        let target = DVec3::new(random.gaussian() * 4.0, 0.0, random.uniform(4.0, 11.0));
        cam_from_world.push(look_at(center, target, random.gaussian() * 0.05));
        // Log-uniform: from a telephone's wide lens to a short telephoto.
        zoom.push((random.uniform(0.8f64.ln(), 1.7f64.ln())).exp());
    }
    let points = (0..options.num_points).map(|_| building(random));
    Layout { cam_from_world, zoom, points: points.collect(), max_distance: 90.0 }
}

/// Hubs on an arc before the building; the k-th has the k-th part of the first one's visitors (Zipf).
fn hubs(num_images: usize, random: &mut Random) -> Vec<Hub> {
    let count = (num_images / 10).clamp(4, 40);
    let mut hubs: Vec<_> = (0..count)
        .map(|k| {
            // Spread over the arc, then shuffled, so that neighbours overlap and popularity has no direction.
            let azimuth = (-65.0 + 130.0 * (k as f64 + random.uniform(0.2, 0.8)) / count as f64).to_radians();
            let distance = random.uniform(22.0, 42.0);
            DVec3::new(distance * azimuth.sin(), -distance * azimuth.cos(), 1.7)
        })
        .collect();
    random.shuffle(&mut hubs);
    hubs.into_iter().enumerate().map(|(k, center)| Hub { center, popularity: 1.0 / (k + 1) as f64 }).collect()
}

fn building(random: &mut Random) -> WorldPoint {
    let height = random.uniform(0.0, HEIGHT);
    let along = random.unit();
    let relief = random.uniform(-0.8, 0.8);
    let (position, normal) = match random.unit() {
        u if u < 0.6 => (DVec3::new((2.0 * along - 1.0) * HALF_WIDTH, relief, height), DVec3::NEG_Y),
        u if u < 0.75 => (DVec3::new(-HALF_WIDTH + relief, along * DEPTH, height), DVec3::NEG_X),
        u if u < 0.9 => (DVec3::new(HALF_WIDTH + relief, along * DEPTH, height), DVec3::X),
        _ => {
            // Statues and people on the square.
            let azimuth = random.uniform(-1.0, 1.0);
            let distance = random.uniform(8.0, 16.0);
            let foot = DVec3::new(distance * azimuth.sin(), -distance * azimuth.cos(), height * 0.15);
            (foot, DVec3::new(azimuth.sin(), -azimuth.cos(), 0.0))
        }
    };
    WorldPoint {
        position,
        normal,
        rgb: tint(random, [200, 190, 170]),
        popularity: (0.35 * random.pareto(POPULARITY_TAIL)).min(1.0),
    }
}
