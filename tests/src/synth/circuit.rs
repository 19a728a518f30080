//! A drive along a ring road and a little further, with the drift of an odometry at the start: the bundle adjustment
//! that block-Jacobi preconditioners crawl on (source: `scale.md` §2, whose street this is by size, drift and noise).

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use glam::{DMat3, DQuat, DVec2, DVec3};

use super::random::{Random, Stream};

/// A circuit. Photographs are a metre apart and look along the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circuit {
    /// Photographs.
    pub images: usize,
    /// Sets how many points there are: each photograph sees about 0.8 times as many.
    pub density: f64,
    /// Rounds driven: what exceeds 1 closes the loop.
    pub laps: f64,
    /// Standard deviation of pixels per axis.
    pub noise_px: f64,
    /// Everything random follows from it.
    pub seed: u64,
}

impl Default for Circuit {
    fn default() -> Self {
        Self { images: 200, density: 500.0, laps: 1.15, noise_px: 0.5, seed: 1 }
    }
}

/// Photographs of a circuit and where odometry believes they were taken; all by one RADIAL camera.
#[derive(Clone, Debug)]
pub struct CircuitScene {
    /// The camera, 1 % and more off.
    pub camera: Camera,
    /// Poses with drift.
    pub cam_from_world: Vec<Rigid3>,
    /// Points that drifted with their first image, and noise.
    pub points: Vec<DVec3>,
    /// One more than points: offsets into the observations.
    pub track_start: Vec<u32>,
    /// Image of each observation, ascending within a point.
    pub observation_image: Vec<u32>,
    /// Pixel of each observation, rounded to `f32` as databases hold it.
    pub observation_px: Vec<DVec2>,
}

/// Focal length, px, and distortion of the true camera, and the start's.
const TRUE_PARAMS: [f64; 5] = [1000.0, 600.0, 500.0, -0.05, 0.01];
const START_PARAMS: [f64; 5] = [1010.0, 600.0, 500.0, -0.045, 0.008];
/// Half the field of view, as tangents.
const VIEW: [f64; 2] = [0.6, 0.5];
/// A point shows to photographs taken from 2 to 25 m before it, and no nearer than 2 m.
const SEEN_FROM: std::ops::Range<i64> = 2..26;
const MIN_DEPTH: f64 = 2.0;
/// Of the photographs that could see a point, these shares do: on the first lap and later.
const DETECTION: [f64; 2] = [0.55, 0.45];
/// Drift of a photograph against the one before, metres per axis, and error of each rotation, radians per axis.
const DRIFT: f64 = 0.02;
const ROTATION_ERROR: f64 = 0.003;
/// Error of points, metres per axis.
const POINT_ERROR: f64 = 0.1;

/// Drives a circuit.
#[must_use]
pub fn circuit(options: &Circuit) -> CircuitScene {
    let mut layout = Random::new(options.seed, Stream::Layout);
    let lap = options.images as f64 / options.laps;
    let radius = lap / std::f64::consts::TAU;
    let truth: Vec<Rigid3> = (0..options.images).map(|i| pose(i as f64, lap, radius, &mut layout)).collect();
    let camera = |params: [f64; 5]| Camera {
        id: 1,
        model: CameraModel::Radial,
        width_px: 1200,
        height_px: 1000,
        params: params.to_vec(),
        has_prior_focal: true,
    };
    let true_camera = camera(TRUE_PARAMS);
    let mut scene = CircuitScene {
        camera: camera(START_PARAMS),
        cam_from_world: Vec::new(),
        points: Vec::new(),
        track_start: vec![0],
        observation_image: Vec::new(),
        observation_px: Vec::new(),
    };
    let mut keypoints = Random::new(options.seed, Stream::Keypoints);
    let mut along: Vec<f64> = {
        let count = (options.density * options.images as f64 / 8.0 * 1.1) as usize;
        (0..count).map(|_| layout.uniform(0.0, lap)).collect()
    };
    along.sort_by(f64::total_cmp);
    for metres in along {
        let side = if layout.chance(0.5) { -1.0 } else { 1.0 };
        let reach = radius + side * layout.uniform(3.0, 15.0);
        let (sin, cos) = (metres / radius).sin_cos();
        let point = DVec3::new(reach * cos, layout.uniform(-3.0, 6.0), reach * sin);
        let seen = track(&truth, point, metres, lap, &mut keypoints);
        if seen.len() < 2 {
            continue;
        }
        for &i in &seen {
            let px = true_camera.project(truth[i as usize].transform_point(point)).unwrap_or(DVec2::ZERO);
            let noise = DVec2::new(keypoints.gaussian(), keypoints.gaussian()) * options.noise_px;
            scene.observation_px.push((px + noise).as_vec2().as_dvec2());
        }
        scene.observation_image.extend(seen);
        scene.points.push(point);
        scene.track_start.push(scene.observation_image.len() as u32);
    }
    drift(&mut scene, &truth, options.seed);
    scene
}

/// The true pose of photograph `i`: on the second lap 1.5 m further out, weaving a little all the time.
fn pose(i: f64, lap: f64, radius: f64, random: &mut Random) -> Rigid3 {
    let (sin, cos) = (i / radius).sin_cos();
    let reach = radius + 0.3 * (i / 15.0).sin() + 1.5 * (i / lap).floor();
    let center = DVec3::new(reach * cos, 0.05 * random.gaussian(), reach * sin);
    // Rows: right, down, along the road.
    let road = DMat3::from_cols(DVec3::new(cos, 0.0, sin), DVec3::Y, DVec3::new(-sin, 0.0, cos)).transpose();
    let shake = random.gaussian3(0.02) + DVec3::Y * 0.1 * (i / 20.0).sin();
    let rotation = DQuat::from_scaled_axis(shake) * DQuat::from_mat3(&road);
    Rigid3::from_rotation_and_center(rotation.normalize(), center)
}

/// Images that see a point `metres` along the road, lap after lap.
fn track(truth: &[Rigid3], point: DVec3, metres: f64, lap: f64, random: &mut Random) -> Vec<u32> {
    let mut seen = Vec::new();
    let mut lap_index = 0;
    loop {
        let at = metres + f64::from(lap_index) * lap;
        if at - metres >= truth.len() as f64 + 30.0 {
            break;
        }
        for before in SEEN_FROM {
            let Ok(i) = usize::try_from(at.floor() as i64 - before) else { continue };
            let Some(pose) = truth.get(i) else { continue };
            let q = pose.transform_point(point);
            let inside = q.z > MIN_DEPTH && (q.x / q.z).abs() < VIEW[0] && (q.y / q.z).abs() < VIEW[1];
            if inside && random.chance(DETECTION[usize::from(lap_index > 0)]) {
                seen.push(i as u32);
            }
        }
        lap_index += 1;
    }
    seen.sort_unstable();
    seen
}

/// The start: a random walk of positions, independent errors of rotations, and points that went along.
fn drift(scene: &mut CircuitScene, truth: &[Rigid3], seed: u64) {
    let mut random = Random::new(seed, Stream::Perturbation);
    let mut moved = Vec::with_capacity(truth.len());
    let mut walk = DVec3::ZERO;
    for pose in truth {
        walk += random.gaussian3(DRIFT);
        moved.push(walk);
        let turn = DQuat::from_scaled_axis(random.gaussian3(ROTATION_ERROR));
        scene.cam_from_world.push(Rigid3::from_rotation_and_center(turn * pose.rotation, pose.center() + walk));
    }
    for (point, start) in scene.points.iter_mut().zip(&scene.track_start) {
        let first = scene.observation_image[*start as usize] as usize;
        *point += moved[first] + random.gaussian3(POINT_ERROR);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circuits_have_the_sizes_of_scale_md() {
        for (images, density, wanted) in [(200, 500.0, 76_000.0), (500, 705.0, 298_000.0)] {
            let scene = circuit(&Circuit { images, density, ..Circuit::default() });
            let observations = scene.observation_px.len() as f64;
            assert!((observations / wanted - 1.0).abs() < 0.05, "{images}: {observations}");
            assert_eq!(scene.track_start.len(), scene.points.len() + 1);
            // Fifteen per cent of the photographs are taken on the second lap and see points of the first.
            let closed = scene.track_start.windows(2).filter(|w| {
                let track = &scene.observation_image[w[0] as usize..w[1] as usize];
                track[track.len() - 1] - track[0] > images as u32 / 2
            });
            assert!(closed.count() > scene.points.len() / 20);
        }
    }
}
