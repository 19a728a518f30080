//! Shared by the bundle tests: a reader of BAL files and synthetic scenes with known truth.

#![allow(dead_code, unreachable_pub)]

#[cfg(feature = "gpu")]
pub mod device;
pub mod extraction;
pub mod metric;

// The synthesiser's own files: a dependency on its package would bring a database into every test of this one.
#[path = "../../../../tests/src/synth/random.rs"]
mod random;
#[path = "../../../../tests/src/synth/circuit.rs"]
mod synth;

use std::path::PathBuf;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel, MAX_PARAMS};
use epipole_optimize::bundle::{self, Options, PoseFreedom, Problem, Solver};
use epipole_optimize::lm::{LmOptions, LmReport};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A BAL problem, or `None` with a note where there is no shared data.
pub fn read_bal(name: &str) -> Option<Problem> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/bal")).join(name);
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("skipped: no shared data at {}", path.display());
        return None;
    };
    let mut numbers = text.split_ascii_whitespace().map(|w| w.parse::<f64>().expect("a number"));
    let mut next = move || numbers.next().expect("a complete file");
    let (images, points, observations) = (next() as usize, next() as usize, next() as usize);
    let mut rows: Vec<(usize, u32, DVec2)> = (0..observations)
        .map(|_| {
            let (image, point) = (next() as u32, next() as usize);
            (point, image, DVec2::new(next(), -next()))
        })
        .collect();
    rows.sort_by_key(|r| r.0);
    let mut problem = Problem::default();
    let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    for i in 0..images {
        let rotation = DQuat::from_scaled_axis(DVec3::new(next(), next(), next()));
        let translation = DVec3::new(next(), next(), next());
        let rotation = DQuat::from_mat3(&(flip * DMat3::from_quat(rotation)));
        problem.cam_from_world.push(Rigid3::new(rotation, flip * translation));
        let (f, k1, k2) = (next(), next(), next());
        problem.cameras.push(camera(i as u32, CameraModel::Radial, vec![f, 0.0, 0.0, k1, k2]));
        problem.image_camera.push(i as u32);
    }
    problem.pose_freedom = vec![PoseFreedom::Free; images];
    let mut refine = [false; MAX_PARAMS];
    [0, 3, 4].iter().for_each(|&k| refine[k] = true);
    problem.refine_params = vec![refine; images];
    problem.param_priors = vec![Vec::new(); images];
    problem.points = (0..points).map(|_| DVec3::new(next(), next(), next())).collect();
    problem.track_start = vec![0; points + 1];
    for (point, image, px) in rows {
        problem.track_start[point + 1] += 1;
        problem.observation_image.push(image);
        problem.observation_px.push(px);
    }
    for p in 0..points {
        problem.track_start[p + 1] += problem.track_start[p];
    }
    Some(problem)
}

pub fn camera(id: u32, model: CameraModel, params: Vec<f64>) -> Camera {
    Camera { id, model, width_px: 1000, height_px: 1000, params, has_prior_focal: false }
}

/// Every camera model with parameters of a plausible lens for 1000 × 1000 px.
pub const LENSES: [(CameraModel, &[f64]); 18] = [
    (CameraModel::SimplePinhole, &[900.0, 500.0, 500.0]),
    (CameraModel::Pinhole, &[900.0, 880.0, 500.0, 500.0]),
    (CameraModel::SimpleRadial, &[900.0, 500.0, 500.0, -0.12]),
    (CameraModel::Radial, &[900.0, 500.0, 500.0, -0.12, 0.03]),
    (CameraModel::OpenCv, &[900.0, 880.0, 500.0, 500.0, -0.12, 0.03, 0.002, -0.0015]),
    (CameraModel::OpenCvFisheye, &[600.0, 590.0, 500.0, 500.0, -0.02, 0.01, -0.003, 0.0005]),
    (CameraModel::FullOpenCv, &[900.0, 880.0, 500.0, 500.0, -0.12, 0.03, 0.002, -0.0015, 0.004, 0.02, -0.01, 0.003]),
    (CameraModel::Fov, &[900.0, 880.0, 500.0, 500.0, 0.9]),
    (CameraModel::SimpleRadialFisheye, &[600.0, 500.0, 500.0, -0.02]),
    (CameraModel::RadialFisheye, &[600.0, 500.0, 500.0, -0.02, 0.01]),
    (
        CameraModel::ThinPrismFisheye,
        &[600.0, 590.0, 500.0, 500.0, -0.02, 0.01, 0.002, -0.0015, -0.003, 0.0005, 0.0012, -0.0008],
    ),
    (
        CameraModel::RadTanThinPrismFisheye,
        &[
            600.0, 590.0, 500.0, 500.0, -0.02, 0.01, -0.003, 0.0005, 0.0002, -0.0001, 0.002, -0.0015, 0.0012, -0.0008,
            0.0006, 0.0004,
        ],
    ),
    (CameraModel::SimpleDivision, &[900.0, 500.0, 500.0, -0.12]),
    (CameraModel::Division, &[900.0, 880.0, 500.0, 500.0, 0.08]),
    (CameraModel::SimpleFisheye, &[600.0, 500.0, 500.0]),
    (CameraModel::Fisheye, &[600.0, 590.0, 500.0, 500.0]),
    (CameraModel::Eucm, &[900.0, 880.0, 500.0, 500.0, 0.6, 1.1]),
    (CameraModel::Equirectangular, &[4000.0, 2000.0]),
];

/// Gives a scene one camera of every model; image `i` has camera `i % 18`. Observations keep their noise. `refine` says
/// of a model's parameter whether it may change.
pub fn mix_models(problem: &mut Problem, refine: impl Fn(CameraModel, usize) -> bool) {
    let before = problem.cameras.clone();
    let image_camera: Vec<u32> = (0..problem.image_camera.len()).map(|i| (i % LENSES.len()) as u32).collect();
    problem.cameras = (0u32..).zip(LENSES).map(|(c, (model, params))| camera(c, model, params.to_vec())).collect();
    problem.refine_params =
        LENSES.map(|(model, params)| std::array::from_fn(|k| k < params.len() && refine(model, k))).to_vec();
    problem.param_priors = vec![Vec::new(); LENSES.len()];
    for (p, track) in problem.track_start.windows(2).enumerate() {
        for o in track[0] as usize..track[1] as usize {
            let image = problem.observation_image[o] as usize;
            let q = problem.cam_from_world[image].transform_point(problem.points[p]);
            let camera = &before[problem.image_camera[image] as usize];
            let noise = problem.observation_px[o] - camera.project(q).expect("in front of the ring");
            let camera = &problem.cameras[image_camera[image] as usize];
            problem.observation_px[o] = camera.project(q).expect("in front of the ring") + noise;
        }
    }
    problem.image_camera = image_camera;
}

/// Shape of a synthetic scene.
#[derive(Clone, Debug)]
pub struct Scene {
    pub images: usize,
    pub points: usize,
    /// Mean track length; observations are spread over a band of neighbouring images.
    pub track: usize,
    /// Width of that band in images.
    pub band: usize,
    pub noise_px: f64,
    pub model: CameraModel,
    pub params: Vec<f64>,
    pub shared: bool,
    pub refine: Vec<usize>,
    pub offset: DVec3,
    pub seed: u64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            images: 12,
            points: 300,
            track: 6,
            band: 8,
            noise_px: 0.5,
            model: CameraModel::SimpleRadial,
            params: vec![900.0, 500.0, 500.0, 0.05],
            shared: true,
            refine: vec![0, 3],
            offset: DVec3::ZERO,
            seed: 7,
        }
    }
}

pub fn gauss(rng: &mut Pcg64Mcg) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

pub fn gauss3(rng: &mut Pcg64Mcg) -> DVec3 {
    DVec3::new(gauss(rng), gauss(rng), gauss(rng))
}

/// A ring of cameras around a cloud of points, at the truth.
pub fn ring(scene: &Scene) -> Problem {
    let mut rng = Pcg64Mcg::seed_from_u64(scene.seed);
    let mut problem = Problem::default();
    for i in 0..scene.images {
        let angle = std::f64::consts::TAU * i as f64 / scene.images as f64;
        let center = DVec3::new(4.0 * angle.cos(), 0.3 * gauss(&mut rng), 4.0 * angle.sin());
        let z = (-center + 0.2 * gauss3(&mut rng)).normalize();
        let x = DVec3::Y.cross(z).normalize();
        let rotation = DMat3::from_cols(x, z.cross(x), z).transpose();
        let pose = Rigid3::from_rotation_and_center(DQuat::from_mat3(&rotation), center + scene.offset);
        problem.cam_from_world.push(pose);
        problem.image_camera.push(if scene.shared { 0 } else { i as u32 });
    }
    let mut refine = [false; MAX_PARAMS];
    scene.refine.iter().for_each(|&k| refine[k] = true);
    for c in 0..if scene.shared { 1 } else { scene.images } {
        problem.cameras.push(camera(c as u32, scene.model, scene.params.clone()));
        problem.refine_params.push(refine);
        problem.param_priors.push(Vec::new());
    }
    problem.pose_freedom = vec![PoseFreedom::Free; scene.images];
    problem.track_start.push(0);
    let mut seen = Vec::new();
    for _ in 0..scene.points {
        let point = gauss3(&mut rng).clamp_length_max(1.5) * 0.8 + scene.offset;
        let first = (rng.random::<f64>() * scene.images as f64) as usize;
        seen.clear();
        let length = (scene.track as f64 * (0.5 + rng.random::<f64>())).round().max(2.0) as usize;
        for _ in 0..length {
            let i = (first + (rng.random::<f64>() * scene.band as f64) as usize) % scene.images;
            if !seen.contains(&i) {
                seen.push(i);
            }
        }
        if seen.len() < 2 {
            seen.push((seen[0] + 1) % scene.images);
        }
        for &i in &seen {
            let camera = &problem.cameras[problem.image_camera[i] as usize];
            let px = camera.project(problem.cam_from_world[i].transform_point(point)).expect("in front of the ring");
            problem.observation_image.push(i as u32);
            problem.observation_px.push(px + scene.noise_px * DVec2::new(gauss(&mut rng), gauss(&mut rng)));
        }
        problem.points.push(point);
        problem.track_start.push(problem.observation_image.len() as u32);
    }
    problem
}

/// Moves a problem away from its state: rotations in degrees, positions in world units.
pub fn perturb(problem: &mut Problem, degrees: f64, position: f64, seed: u64) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    for (pose, freedom) in problem.cam_from_world.iter_mut().zip(&problem.pose_freedom) {
        let turn = DQuat::from_scaled_axis(gauss3(&mut rng) * degrees.to_radians());
        let shift = gauss3(&mut rng) * position;
        let rotation = if *freedom == PoseFreedom::Free { turn * pose.rotation } else { pose.rotation };
        let center = if *freedom == PoseFreedom::Fixed { pose.center() } else { pose.center() + shift };
        if *freedom != PoseFreedom::Fixed {
            *pose = Rigid3::from_rotation_and_center(rotation, center);
        }
    }
    if !problem.fixed_points {
        problem.points.iter_mut().for_each(|p| *p += gauss3(&mut rng) * position);
    }
}

/// The circuits of `scale.md` §2 as problems: 200 images with 76 000 observations, 500 with 298 000; one shared camera,
/// squared loss.
pub fn circuit(images: usize) -> Problem {
    let density = if images < 500 { 500.0 } else { 705.0 };
    let scene = synth::circuit(&synth::Circuit { images, density, ..Default::default() });
    let mut refine = [false; MAX_PARAMS];
    [0, 3, 4].iter().for_each(|&k| refine[k] = true);
    Problem {
        image_camera: vec![0; images],
        pose_freedom: vec![PoseFreedom::Free; images],
        cameras: vec![scene.camera],
        refine_params: vec![refine],
        param_priors: vec![Vec::new()],
        cam_from_world: scene.cam_from_world,
        points: scene.points,
        track_start: scene.track_start,
        observation_image: scene.observation_image,
        observation_px: scene.observation_px,
        ..Problem::default()
    }
}

/// What `f64` with a Cholesky factor in every step ends at.
pub fn circuit_optimum(problem: &Problem) -> f64 {
    let lm = LmOptions { max_iterations: 100, relative_decrease_tolerance: 1e-9, ..LmOptions::default() };
    let options = Options { lm, solver: Solver::Cholesky, ..Options::default() };
    bundle::solve(&mut problem.clone(), &options, &mut ()).expect("a good problem").final_cost
}

/// Products until the cost is within a share of the optimum.
pub fn products_to(report: &LmReport, optimum: f64, share: f64) -> Option<usize> {
    let mut products = 0;
    report.history.iter().find_map(|record| {
        products += record.inner_iterations;
        (record.accepted && record.cost <= optimum * (1.0 + share)).then_some(products)
    })
}

pub fn print_products(name: &str, report: &LmReport, optimum: f64, seconds: f64) {
    let to = |share: f64| products_to(report, optimum, share).map_or("never".to_string(), |n| n.to_string());
    println!(
        "{name}: {} steps ({} refused), {} products, {} to 1e-4, {} to 1e-6, gap {:.1e}, {seconds:.1} s",
        report.iterations,
        report.rejected,
        report.inner_iterations,
        to(1e-4),
        to(1e-6),
        report.final_cost / optimum - 1.0,
    );
    let inner: Vec<usize> = report.history.iter().map(|r| r.inner_iterations).collect();
    println!("    products by step {inner:?}");
}

/// The benchmark's scene of about so many observations: 5 a point and 0.8 √N images, as in BAL's Venice (5.0 million,
/// 1778 images); every image with its own focal length and distortion.
pub fn bench_scene(observations: usize) -> Scene {
    let images = ((0.8 * (observations as f64).sqrt()).round() as usize).max(8);
    let band = (images / 8).clamp(8, 60);
    // A track draws five images of the band on average; those drawn twice count once.
    let other = 1.0 - 1.0 / band as f64;
    let distinct = band as f64 * (1.0 - other.powi(5));
    let points = (observations as f64 / distinct).round() as usize;
    Scene { images, points, track: 5, band, shared: false, ..Scene::default() }
}
