//! The linearisation against central differences: poses, shared and own intrinsics, points.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel, MAX_PARAMS};
use glam::{DQuat, DVec2, DVec3};

use super::camera_step::CameraStep;
use super::depth_limits::DepthLimits;
use super::linearization::Linearization;
use super::rows::Losses;
use super::state::{Cameras, Lattice, Points};
use super::structure::Structure;
use super::trial::evaluate;
use super::{PIXELS, WITH_DEPTH};
use crate::active::{Activation, ActiveSet};
use crate::bundle::{Depth, PoseFreedom, Problem};
use crate::executor::block_on;
use crate::loss::Loss;

/// Three images: two share a camera, one has its own; the second may only move, not turn.
fn problem() -> Problem {
    let camera = |id, model, params: &[f64]| Camera {
        id,
        model,
        width_px: 1000,
        height_px: 800,
        params: params.to_vec(),
        has_prior_focal: true,
    };
    let mut problem = Problem {
        image_camera: vec![0, 0, 1],
        pose_freedom: vec![PoseFreedom::Free, PoseFreedom::RotationFixed, PoseFreedom::Free],
        cameras: vec![
            camera(1, CameraModel::SimpleRadial, &[800.0, 500.0, 400.0, 0.1]),
            camera(2, CameraModel::OpenCv, &[700.0, 710.0, 500.0, 400.0, 0.05, -0.02, 0.001, -0.002]),
        ],
        refine_params: vec![[true; MAX_PARAMS]; 2],
        param_priors: vec![Vec::new(); 2],
        track_start: vec![0],
        ..Problem::default()
    };
    for i in 0..3 {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.1, -0.2 * f64::from(i), 0.3));
        problem.cam_from_world.push(Rigid3::new(turn, DVec3::new(0.4 * f64::from(i), 0.1, 0.2)));
    }
    for k in 0..9 {
        let k = f64::from(k);
        problem.points.push(DVec3::new((k * 1.7).sin(), (k * 2.3).cos(), 4.0 + (k * 0.9).sin()));
        for image in 0..3 {
            problem.observation_image.push(image);
            problem.observation_px.push(DVec2::new(500.0, 400.0));
        }
        problem.track_start.push(problem.observation_image.len() as u32);
    }
    problem
}

#[test]
fn derivatives_agree_with_central_differences() {
    derivatives_agree::<PIXELS>(&problem());
    let mut problem = problem();
    let mut depth = Depth::unknown(problem.observation_image.len());
    (0..problem.observation_image.len()).step_by(2).for_each(|o| depth.set(o, 3.0, 0.05));
    depth.loss = Loss::Squared;
    problem.depth = Some(depth);
    derivatives_agree::<WITH_DEPTH>(&problem);
}

fn derivatives_agree<const ROWS: usize>(problem: &Problem) {
    let structure = Structure::new(problem);
    // Poses 6 + 3 + 6, the third image's own camera 8, the shared camera 4.
    assert_eq!(structure.layout.dim(), 27);
    let lattice = Lattice::new::<f64>(problem, &structure);
    let (cameras, points) = (Cameras::<f64>::new(problem, &lattice), Points::new(problem, &lattice));
    let depths = DepthLimits::new(problem, Activation::ValidAtStart);
    let residuals = |cameras: &Cameras<f64>, points: &Points<f64>| {
        let mut out = vec![[0.0; ROWS]; structure.image.len()];
        evaluate(&structure, &lattice, cameras, points, &depths, &mut out);
        out
    };
    let residual = residuals(&cameras, &points);
    let mut active = ActiveSet::new(Activation::ValidAtStart, Loss::Squared, residual.len());
    active.update(|o| residual[o][0], |_| 0.0, |_| true);
    assert_eq!(active.count(), 27);
    let losses = Losses::new(problem);
    let mut linearization = Linearization::new(&structure);
    let (side, observer) = (depths.side, &mut ());
    block_on(
        linearization.update(&structure, &lattice, &cameras, &points, &residual, &active, losses, 1.0, side, observer),
    );

    let h = 1e-6;
    let agree = |plus: &[[f64; ROWS]], minus: &[[f64; ROWS]], o: usize, derivative: [f64; ROWS]| {
        for k in 0..ROWS {
            let difference = (plus[o][k] - minus[o][k]) / (2.0 * h);
            assert!(
                (difference - derivative[k]).abs() < 1e-5 * (1.0 + difference.abs()),
                "{o} {difference} {derivative:?}"
            );
        }
    };
    for unknown in 0..structure.layout.dim() {
        let mut x = vec![0.0; structure.layout.dim()];
        x[unknown] = h;
        let plus = residuals(&cameras.stepped(&structure, &lattice, &x), &points);
        x[unknown] = -h;
        let minus = residuals(&cameras.stepped(&structure, &lattice, &x), &points);
        x[unknown] = 1.0;
        let step = CameraStep::<f64>::new(&structure, &x);
        for o in 0..residual.len() {
            let i = structure.image[o] as usize;
            let params = step.params(structure.camera[i] as usize);
            agree(&plus, &minus, o, linearization.camera_product(o, &step.pose[i], params));
        }
    }
    for axis in 0..3 {
        let moved = |by: f64| {
            let mut points = points.clone();
            points.offset.iter_mut().for_each(|p| p[axis] += by);
            residuals(&cameras, &points)
        };
        let (plus, minus) = (moved(h), moved(-h));
        for o in 0..residual.len() {
            let row = &linearization.rows[o];
            agree(&plus, &minus, o, row.point.map(|row| row[axis]));
        }
    }
}
