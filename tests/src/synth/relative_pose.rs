//! The relative pose a two-view solver would store: the least-squares fit to a pair's noisy rays, started at the truth.

use epipole_geometry::Rigid3;
use glam::{DMat3, DQuat, DVec3};

/// Gauss–Newton steps; from the truth three reach the noise floor.
const STEPS: usize = 5;
/// Step of the numeric derivatives, rad: the square root of f64's precision.
const DERIVATIVE_STEP_RAD: f64 = 1e-7;

/// `[t]× R` of a relative pose.
pub(crate) fn essential(cam2_from_cam1: &Rigid3) -> DMat3 {
    let t = cam2_from_cam1.translation;
    let cross = DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0));
    cross * cam2_from_cam1.rotation_matrix()
}

/// First-order distance of a pair of unit rays from the epipolar constraint, on the sphere, rad
/// (Sampson's error with the constraint's gradients projected to the rays' tangent planes).
pub(crate) fn sampson_rad(essential: &DMat3, rays: &[DVec3; 2]) -> f64 {
    let line2 = *essential * rays[0];
    let line1 = essential.transpose() * rays[1];
    let tangent = |v: DVec3, ray: DVec3| v - ray * v.dot(ray);
    let gradient = tangent(line2, rays[1]).length_squared() + tangent(line1, rays[0]).length_squared();
    rays[1].dot(line2) / gradient.max(1e-300).sqrt()
}

/// Moves a pose by a rotation vector (left, rad) and a tangent step of its unit translation (rad).
fn moved(pose: &Rigid3, step: &[f64; 5]) -> Rigid3 {
    let (u, v) = pose.translation.normalize_or(DVec3::Z).any_orthonormal_pair();
    Rigid3 {
        rotation: (DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2])) * pose.rotation).normalize(),
        translation: (pose.translation + u * step[3] + v * step[4]).normalize_or(pose.translation),
    }
}

/// The pose with unit translation that minimises the squared Sampson errors of the rays, near `start`.
pub(crate) fn refine(start: &Rigid3, rays: &[[DVec3; 2]]) -> Rigid3 {
    let mut pose = *start;
    for _ in 0..STEPS {
        let at = essential(&pose);
        let nearby: [DMat3; 5] = std::array::from_fn(|k| {
            let mut step = [0.0; 5];
            step[k] = DERIVATIVE_STEP_RAD;
            essential(&moved(&pose, &step))
        });
        // Normal equations with their right-hand side as the sixth column.
        let mut normal = [[0.0; 6]; 5];
        for pair in rays {
            let residual = sampson_rad(&at, pair);
            let row: [f64; 5] = nearby.map(|e| (sampson_rad(&e, pair) - residual) / DERIVATIVE_STEP_RAD);
            for i in 0..5 {
                for j in 0..5 {
                    normal[i][j] += row[i] * row[j];
                }
                normal[i][5] -= row[i] * residual;
            }
        }
        let Some(step) = eliminate(normal) else { return pose };
        // A step of more than a tenth of a radian means that the pair does not fix its pose.
        if step.iter().any(|s| s.abs() > 0.1) {
            return pose;
        }
        pose = moved(&pose, &step);
    }
    pose
}

/// Gaussian elimination with a little damping; the matrix is positive semi-definite, so no pivoting is needed.
fn eliminate(mut a: [[f64; 6]; 5]) -> Option<[f64; 5]> {
    for i in 0..5 {
        a[i][i] *= 1.0 + 1e-9;
    }
    for i in 0..5 {
        if a[i][i].is_nan() || a[i][i] <= 0.0 {
            return None;
        }
        for row in i + 1..5 {
            let factor = a[row][i] / a[i][i];
            for column in i..6 {
                a[row][column] -= factor * a[i][column];
            }
        }
    }
    let mut x = [0.0; 5];
    for i in (0..5).rev() {
        let known: f64 = (i + 1..5).map(|j| a[i][j] * x[j]).sum();
        x[i] = (a[i][5] - known) / a[i][i];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::random::{Random, Stream};

    #[test]
    fn refinement_finds_the_pose_of_exact_rays() {
        let mut random = Random::new(3, Stream::Pairs);
        let truth = Rigid3::new(DQuat::from_scaled_axis(DVec3::new(0.1, -0.3, 0.05)), DVec3::new(0.8, 0.1, -0.2));
        let truth = Rigid3 { translation: truth.translation.normalize(), ..truth };
        let rays: Vec<_> = (0..50)
            .map(|_| {
                let p = DVec3::new(random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0), random.uniform(3.0, 8.0));
                [p.normalize(), truth.transform_point(p).normalize()]
            })
            .collect();
        let start = moved(&truth, &[0.01, -0.02, 0.015, 0.02, -0.01]);
        let found = refine(&start, &rays);
        assert!(found.rotation.angle_between(truth.rotation) < 1e-6);
        assert!(found.translation.distance(truth.translation) < 1e-6);
    }
}
