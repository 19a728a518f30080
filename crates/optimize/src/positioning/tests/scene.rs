//! The three small worlds of `reference/solver.md` §3.3: an orbit, a street and an unordered facade.

use glam::{DMat3, DVec3};

use crate::positioning::Problem;

/// A generator of its own (SplitMix64), so that scenes never change with a dependency.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform(1e-300, 1.0).ln()).sqrt();
        radius * self.uniform(0.0, std::f64::consts::TAU).cos()
    }

    pub(crate) fn normals(&mut self) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal())
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    Orbit,
    Street,
    Facade,
}

pub(crate) const KINDS: [Kind; 3] = [Kind::Orbit, Kind::Street, Kind::Facade];

/// What spoils the rays.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Noise {
    /// Standard deviation of a ray, rad.
    pub(crate) ray_rad: f64,
    /// Standard deviation of each image's rotation about each axis, degrees.
    pub(crate) rotation_deg: f64,
    /// Share of rays that point elsewhere.
    pub(crate) outliers: f64,
}

/// A problem and the truth behind it.
pub(crate) struct Scene {
    pub(crate) problem: Problem,
    pub(crate) centers: Vec<DVec3>,
    pub(crate) points: Vec<DVec3>,
}

const CAMERAS: usize = 50;
const POINTS: usize = 700;
const POINTS_PER_CAMERA: usize = 120;

/// 50 cameras.
pub(crate) fn scene(kind: Kind, noise: Noise, seed: u64) -> Scene {
    scene_of(kind, noise, seed, CAMERAS)
}

/// As many cameras as asked for, with points in proportion.
pub(crate) fn scene_of(kind: Kind, noise: Noise, seed: u64, cameras: usize) -> Scene {
    let num_points = POINTS * cameras / CAMERAS;
    let mut random = Random(seed);
    let r = &mut random;
    let (mut centers, mut forward, mut points) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..cameras {
        let (center, direction) = match kind {
            Kind::Orbit => {
                let angle = std::f64::consts::TAU * i as f64 / cameras as f64;
                let center = DVec3::new(6.0 * angle.sin(), 0.7 * r.normal(), -6.0 * angle.cos());
                (center, -center)
            }
            Kind::Street => {
                let i = i as f64;
                (DVec3::new(3.0 * (i / 10.0).sin(), 0.1 * r.normal(), 2.0 * i), DVec3::Z)
            }
            Kind::Facade => {
                let center = DVec3::new(r.uniform(-15.0, 15.0), r.uniform(-1.0, 3.0), -r.uniform(4.0, 40.0));
                (center, DVec3::new(r.uniform(-10.0, 10.0), r.uniform(0.0, 6.0), 0.0) - center)
            }
        };
        centers.push(center);
        forward.push(direction.normalize());
    }
    for _ in 0..num_points {
        points.push(match kind {
            Kind::Orbit => r.normals(),
            Kind::Street => {
                let side = if r.bits() & 1 == 0 { 1.0 } else { -1.0 };
                let x = side * r.uniform(4.0, 15.0);
                DVec3::new(x, r.uniform(-2.0, 8.0), r.uniform(0.0, 2.0 * cameras as f64 + 20.0))
            }
            Kind::Facade => DVec3::new(r.uniform(-15.0, 15.0), r.uniform(-2.0, 12.0), 1.5 * r.normal()),
        });
    }
    let cos_view = match kind {
        Kind::Orbit => 0.85,
        Kind::Street => 0.8,
        Kind::Facade => 0.9,
    };
    let mut tracks: Vec<Vec<(u32, DVec3)>> = vec![Vec::new(); num_points];
    for i in 0..cameras {
        let rotation = rotation(noise.rotation_deg.to_radians() * r.normals());
        let mut seen: Vec<usize> = (0..num_points)
            .filter(|&p| {
                let d: DVec3 = points[p] - centers[i];
                d.dot(forward[i]) / d.length() > cos_view && d.length() < 40.0 && d.length() > 1.0
            })
            .collect();
        while seen.len() > POINTS_PER_CAMERA {
            seen.swap_remove(r.below(seen.len()));
        }
        for p in seen {
            let mut ray = rotation * (points[p] - centers[i]).normalize() + noise.ray_rad * r.normals();
            if r.uniform(0.0, 1.0) < noise.outliers {
                ray += 0.7 * r.normals();
            }
            tracks[p].push((i as u32, ray.normalize()));
        }
    }
    let mut problem = Problem { track_start: vec![0], image_weight: vec![1.0; cameras], ..Problem::default() };
    let mut kept = Vec::new();
    for (p, track) in tracks.into_iter().enumerate().filter(|(_, track)| track.len() >= 3) {
        kept.push(points[p]);
        for (image, ray) in track {
            problem.observation_image.push(image);
            problem.observation_ray.push(ray);
        }
        problem.track_start.push(problem.observation_image.len() as u32);
    }
    problem.centers = vec![DVec3::ZERO; cameras];
    problem.points = vec![DVec3::ZERO; kept.len()];
    Scene { problem, centers, points: kept }
}

/// A few images and points with few distinct rays: parallel, opposite and repeated ones are common, and so are repeated
/// images and absurd pins.
pub(crate) fn garbage(random: &mut Random) -> Problem {
    let images = 1 + random.below(6);
    let points = 1 + random.below(8);
    let mut problem = Problem {
        centers: vec![DVec3::NAN; images],
        points: vec![DVec3::NAN; points],
        image_weight: vec![1.0; images],
        track_start: vec![0],
        ..Problem::default()
    };
    for _ in 0..points {
        for _ in 0..random.below(6) {
            problem.observation_image.push(random.below(images) as u32);
            let axis = [DVec3::X, DVec3::Z, DVec3::new(0.6, 0.0, 0.8)][random.below(3)];
            problem.observation_ray.push(if random.below(4) == 0 { -axis } else { axis });
        }
        problem.track_start.push(problem.observations() as u32);
    }
    if random.below(3) == 0 {
        let pins = (0..problem.observations()).map(|_| [0.0, 1e-6, 1.0, 1e6][random.below(4)]).collect();
        problem.pinned_scale = Some(pins);
    }
    problem
}

/// The rotation by a vector, rad.
pub(crate) fn rotation(vector: DVec3) -> DMat3 {
    let angle = vector.length();
    if angle > 0.0 { DMat3::from_axis_angle(vector / angle, angle) } else { DMat3::IDENTITY }
}

/// Median and largest distance after the best similarity (least squares), over the radius of the truth.
pub(crate) fn aligned_error(found: &[DVec3], truth: &[DVec3]) -> (f64, f64) {
    let mean = |v: &[DVec3]| v.iter().sum::<DVec3>() / v.len() as f64;
    let (mean_found, mean_truth) = (mean(found), mean(truth));
    let mut rotation = DMat3::IDENTITY;
    let mut scale = 1.0;
    // World rotations are given by the rays and are never far off: a few small-angle steps align exactly.
    for _ in 0..20 {
        let (mut inertia, mut torque, mut along, mut square) = (DMat3::ZERO, DVec3::ZERO, 0.0, 0.0);
        for (f, t) in found.iter().zip(truth) {
            let (a, b) = (rotation * (*f - mean_found), *t - mean_truth);
            along += a.dot(b);
            square += a.length_squared();
            inertia +=
                DMat3::from_diagonal(DVec3::splat(a.length_squared())) - DMat3::from_cols(a * a.x, a * a.y, a * a.z);
            torque += a.cross(b);
        }
        scale = along / square;
        rotation = self::rotation(inertia.inverse() * torque / scale) * rotation;
    }
    let radius = (truth.iter().map(|t| (*t - mean_truth).length_squared()).sum::<f64>() / truth.len() as f64).sqrt();
    let mut errors: Vec<f64> = found
        .iter()
        .zip(truth)
        .map(|(f, t)| (scale * (rotation * (*f - mean_found)) - (*t - mean_truth)).length() / radius)
        .collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() / 2], errors[errors.len() - 1])
}
