//! A BAL problem as a bundle problem and back.
//!
//! BAL looks along −z with y up: `p = −P.xy/P.z`. Turning each camera by F = diag(1, −1, −1) and negating y of the
//! pixels gives the convention of this project (along +z, y down) with the same residuals up to sign.

use epipole_formats::bal::BalProblem;
use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel, MAX_PARAMS};
use epipole_optimize::Loss;
use epipole_optimize::bundle::{PoseFreedom, Problem};
use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::error::CliError;

/// The half turn about x, F.
const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
/// Parameters of RADIAL that BAL has: f, k1, k2. The principal point is the origin of its pixels.
const PARAMS: [usize; 3] = [0, 3, 4];

/// Which cameras see the world upside down: the sign that f was multiplied with, per camera.
pub(super) type Signs = Vec<f64>;

/// The problem, every camera free and with its own intrinsics.
///
/// A camera with a negative focal length is turned half round its axis (x and y change sign, f becomes positive), which
/// leaves its residuals as they are.
pub(super) fn problem(bal: &BalProblem) -> Result<(Problem, Signs), CliError> {
    let too_large = || CliError::Usage("the problem has more than 4294967295 observations; split it".into());
    let total = u32::try_from(bal.observations.len()).map_err(|_| too_large())?;
    let mut refine = [false; MAX_PARAMS];
    PARAMS.iter().for_each(|&index| refine[index] = true);
    let count = bal.cameras.len();
    let signs: Signs = bal.cameras.iter().map(|camera| if camera[6] < 0.0 { -1.0 } else { 1.0 }).collect();
    let mut problem = Problem {
        cam_from_world: bal.cameras.iter().zip(&signs).map(|(camera, &sign)| pose(camera, sign)).collect(),
        image_camera: (0..count as u32).collect(),
        pose_freedom: vec![PoseFreedom::Free; count],
        cameras: bal.cameras.iter().enumerate().map(|(i, camera)| intrinsics(i as u32, camera)).collect(),
        refine_params: vec![refine; count],
        param_priors: vec![Vec::new(); count],
        points: bal.points.clone(),
        fixed_points: false,
        track_start: vec![0; bal.points.len() + 1],
        observation_image: vec![0; bal.observations.len()],
        observation_px: vec![DVec2::ZERO; bal.observations.len()],
        loss: Loss::Squared,
        depth: None,
    };
    for &(_, point, _) in &bal.observations {
        problem.track_start[point as usize + 1] += 1;
    }
    for point in 0..bal.points.len() {
        problem.track_start[point + 1] += problem.track_start[point];
    }
    debug_assert_eq!(problem.track_start.last(), Some(&total));
    // Sorted by point, in the order of the file within a point.
    let mut next = problem.track_start.clone();
    for &(camera, point, px) in &bal.observations {
        let slot = next[point as usize] as usize;
        next[point as usize] += 1;
        problem.observation_image[slot] = camera;
        problem.observation_px[slot] = DVec2::new(px.x, -px.y);
    }
    Ok((problem, signs))
}

fn turn(sign: f64) -> DMat3 {
    DMat3::from_diagonal(DVec3::new(sign, sign, 1.0))
}

fn pose(&[rx, ry, rz, tx, ty, tz, ..]: &[f64; 9], sign: f64) -> Rigid3 {
    let flip = turn(sign) * FLIP;
    let rotation = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(rx, ry, rz)));
    Rigid3::new(DQuat::from_mat3(&(flip * rotation)), flip * DVec3::new(tx, ty, tz))
}

fn intrinsics(id: u32, &[.., f, k1, k2]: &[f64; 9]) -> Camera {
    let params = vec![f.abs(), 0.0, 0.0, k1, k2];
    // BAL does not know the size of its images; the formula does not need it.
    Camera { id, model: CameraModel::Radial, width_px: 1, height_px: 1, params, has_prior_focal: false }
}

/// Writes the state of the problem into the BAL problem it came from.
pub(super) fn apply(problem: &Problem, signs: &Signs, bal: &mut BalProblem) {
    for (((camera, pose), intrinsics), &sign) in
        bal.cameras.iter_mut().zip(&problem.cam_from_world).zip(&problem.cameras).zip(signs)
    {
        let unflip = FLIP * turn(sign);
        let rotation = DQuat::from_mat3(&(unflip * pose.rotation_matrix()));
        // Of the two vectors of a rotation, the one of at most half a turn.
        let rotation = if rotation.w < 0.0 { -rotation } else { rotation }.to_scaled_axis();
        let translation = unflip * pose.translation;
        camera[..3].copy_from_slice(&rotation.to_array());
        camera[3..6].copy_from_slice(&translation.to_array());
        camera[6] = sign * intrinsics.params[0];
        camera[7..].copy_from_slice(&intrinsics.params[3..5]);
    }
    bal.points.clone_from(&problem.points);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bal() -> BalProblem {
        BalProblem {
            cameras: vec![
                [0.1, -0.2, 0.3, 1.0, 2.0, -9.0, 500.0, -1e-2, 3e-3],
                [-2.0, 1.5, 0.3, 0.1, 0.2, -8.0, -400.0, 1e-2, 0.0],
            ],
            points: vec![DVec3::new(0.1, 0.2, -0.3), DVec3::new(-1.0, 0.5, 0.4)],
            observations: vec![
                (1, 1, DVec2::new(1.0, 2.0)),
                (0, 1, DVec2::new(3.0, -4.0)),
                (0, 0, DVec2::new(0.0, 7.0)),
            ],
        }
    }

    /// The formula of the BAL page.
    fn bal_pixel(&[rx, ry, rz, tx, ty, tz, f, k1, k2]: &[f64; 9], point: DVec3) -> DVec2 {
        let in_cam = DQuat::from_scaled_axis(DVec3::new(rx, ry, rz)) * point + DVec3::new(tx, ty, tz);
        let p = -in_cam.truncate() / in_cam.z;
        f * (1.0 + k1 * p.length_squared() + k2 * p.length_squared().powi(2)) * p
    }

    #[test]
    fn residuals_are_the_same_and_the_way_back_is_exact() {
        let mut bal = bal();
        let (problem, signs) = problem(&bal).expect("small");
        assert_eq!(problem.track_start, [0, 1, 3]);
        assert_eq!(problem.observation_image, [0, 1, 0]);
        for &(camera, point, _) in &bal.observations {
            let in_cam = problem.cam_from_world[camera as usize].transform_point(bal.points[point as usize]);
            let ours = problem.cameras[camera as usize].project(in_cam).expect("in front");
            let theirs = bal_pixel(&bal.cameras[camera as usize], bal.points[point as usize]);
            assert!((ours - DVec2::new(theirs.x, -theirs.y)).length() < 1e-10, "{ours} {theirs}");
        }
        let before = bal.clone();
        apply(&problem, &signs, &mut bal);
        for (a, b) in before.cameras.iter().flatten().zip(bal.cameras.iter().flatten()) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
        assert_eq!(before.points, bal.points);
    }
}
