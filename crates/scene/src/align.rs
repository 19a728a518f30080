//! The similarity or rigid motion that brings one set of points onto another, by least squares or despite outliers.

use epipole_geometry::Similarity3;
use glam::{DMat3, DQuat, DVec3};
use nalgebra::Matrix3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

/// Points in a sample: a similarity needs three.
const SAMPLE: usize = 3;

/// The similarity `b_from_a` that minimises `Σ‖b − (s R a + t)‖²` (source: Umeyama, PAMI 1991).
///
/// `None` if the lists differ in length, hold fewer than three points, or a number is not finite. Points on one line
/// leave the turn around it free: some minimiser is returned. The scale is 1 if all points of `a` coincide.
pub fn align_similarity(a: &[DVec3], b: &[DVec3]) -> Option<Similarity3> {
    align(a, b, true)
}

/// The rigid motion `b_from_a` (scale 1) that minimises `Σ‖b − (R a + t)‖²`; `None` as for [`align_similarity`].
pub fn align_rigid(a: &[DVec3], b: &[DVec3]) -> Option<Similarity3> {
    align(a, b, false)
}

fn align(a: &[DVec3], b: &[DVec3], with_scale: bool) -> Option<Similarity3> {
    if a.len() != b.len() || a.len() < SAMPLE || a.iter().chain(b).any(|p| !p.is_finite()) {
        return None;
    }
    let n = a.len() as f64;
    let mean_a = a.iter().sum::<DVec3>() / n;
    let mean_b = b.iter().sum::<DVec3>() / n;
    let mut covariance = DMat3::ZERO;
    let mut variance_a = 0.0;
    for (&a, &b) in a.iter().zip(b) {
        let (a, b) = (a - mean_a, b - mean_b);
        covariance += DMat3::from_cols(b * a.x, b * a.y, b * a.z);
        variance_a += a.length_squared();
    }
    let (rotation, trace) = nearest_rotation(&(covariance * (1.0 / n)))?;
    variance_a /= n;
    let scale = if with_scale && variance_a > 0.0 { trace / variance_a } else { 1.0 };
    // Opposite point sets can ask for a scale of zero; that is no similarity.
    (scale.is_finite() && scale > 0.0).then(|| {
        let rotation = DQuat::from_mat3(&rotation).normalize();
        Similarity3 { scale, rotation, translation: mean_b - scale * (rotation * mean_a) }
    })
}

/// The rotation `R` with the largest `tr(Rᵀ M)`, and that trace: `U diag(1, 1, det(U Vᵀ)) Vᵀ` of `M = U Σ Vᵀ`.
/// `None` if a number is not finite.
pub(crate) fn nearest_rotation(matrix: &DMat3) -> Option<(DMat3, f64)> {
    if !matrix.is_finite() {
        return None;
    }
    let svd = Matrix3::from_column_slice(&matrix.to_cols_array()).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // The direction to flip is that of the smallest singular value, wherever it was sorted.
    let smallest = svd.singular_values.imin();
    let mut signs = nalgebra::Vector3::repeat(1.0);
    if (u * v_t).determinant() < 0.0 {
        signs[smallest] = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
    Some((DMat3::from_cols_slice(rotation.as_slice()), svd.singular_values.dot(&signs)))
}

/// Settings of [`align_robust`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobustAlignment {
    /// A pair of points agrees if it lies within this distance after the motion, in units of `b`.
    pub max_distance: f64,
    /// Number of samples of three points.
    pub trials: usize,
    /// Seed of the samples.
    pub seed: u64,
}

/// The similarity that most pairs of points agree with, re-estimated from all of those (RANSAC), and which pairs
/// agreed with the sample it came from. `None` as for [`align_similarity`], or if no sample of three points agrees with
/// at least three pairs.
pub fn align_robust(a: &[DVec3], b: &[DVec3], options: &RobustAlignment) -> Option<(Similarity3, Vec<bool>)> {
    let n = a.len();
    if n != b.len() || n < SAMPLE {
        return None;
    }
    let agrees = |m: &Similarity3, i: usize| m.transform_point(a[i]).distance(b[i]) < options.max_distance;
    let mut rng = Pcg32::seed_from_u64(options.seed);
    let mut best: Option<(usize, Similarity3)> = None;
    // Three points make one sample only.
    let trials = if n == SAMPLE { 1 } else { options.trials };
    for _ in 0..trials {
        let picked = distinct_three(&mut rng, n);
        let Some(motion) = align_similarity(&picked.map(|i| a[i]), &picked.map(|i| b[i])) else { continue };
        let count = (0..n).filter(|&i| agrees(&motion, i)).count();
        if best.as_ref().is_none_or(|(most, _)| count > *most) {
            best = Some((count, motion));
        }
    }
    let (_, sample_motion) = best.filter(|(count, _)| *count >= SAMPLE)?;
    let mask: Vec<bool> = (0..n).map(|i| agrees(&sample_motion, i)).collect();
    let kept = |points: &[DVec3]| -> Vec<DVec3> {
        points.iter().zip(&mask).filter(|(_, keep)| **keep).map(|(p, _)| *p).collect()
    };
    Some((align_similarity(&kept(a), &kept(b))?, mask))
}

fn distinct_three(rng: &mut Pcg32, n: usize) -> [usize; SAMPLE] {
    let first = rng.random_range(0..n);
    let second = (first + rng.random_range(1..n)) % n;
    loop {
        let third = rng.random_range(0..n);
        if third != first && third != second {
            return [first, second, third];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> Similarity3 {
        Similarity3 {
            scale: 2.5,
            rotation: DQuat::from_xyzw(0.3, -0.1, 0.2, 0.8).normalize(),
            translation: DVec3::new(4.0, -1.0, 0.5),
        }
    }

    fn cloud(n: usize) -> Vec<DVec3> {
        let mut rng = Pcg32::seed_from_u64(5);
        let mut coordinate = || rng.random_range(-1.0..1.0);
        (0..n).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect()
    }

    fn distance(x: &Similarity3, y: &Similarity3) -> f64 {
        cloud(20).into_iter().map(|p| x.transform_point(p).distance(y.transform_point(p))).fold(0.0, f64::max)
    }

    #[test]
    fn exact_points_give_the_exact_motion() {
        for n in [3, 4, 50] {
            let a = cloud(n);
            let b: Vec<_> = a.iter().map(|&p| truth().transform_point(p)).collect();
            assert!(distance(&align_similarity(&a, &b).expect("three points"), &truth()) < 1e-12);
            let rigid = Similarity3 { scale: 1.0, ..truth() };
            let b: Vec<_> = a.iter().map(|&p| rigid.transform_point(p)).collect();
            assert!(distance(&align_rigid(&a, &b).expect("three points"), &rigid) < 1e-12);
        }
    }

    #[test]
    fn mirrored_and_flat_points_get_a_rotation() {
        for flatten in [DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, 1.0, 0.0)] {
            let a = cloud(30);
            let b: Vec<_> = a.iter().map(|&p| p * flatten).collect();
            let motion = align_similarity(&a, &b).expect("three points");
            assert!((DMat3::from_quat(motion.rotation).determinant() - 1.0).abs() < 1e-12 && motion.scale > 0.0);
        }
    }

    #[test]
    fn the_least_squares_motion_is_a_minimum() {
        let a = cloud(40);
        let noise = cloud(40);
        let b: Vec<_> =
            a.iter().zip(&noise).map(|(&p, &e)| truth().transform_point(p) + 0.1 * DVec3::new(e.z, e.x, e.y)).collect();
        let best = align_similarity(&a, &b).expect("three points");
        let cost =
            |m: &Similarity3| a.iter().zip(&b).map(|(&p, &q)| m.transform_point(p).distance_squared(q)).sum::<f64>();
        for change in [1e-3, -1e-3] {
            let turn = |axis: DVec3| DQuat::from_axis_angle(axis, change) * best.rotation;
            let others = [
                Similarity3 { scale: best.scale + change, ..best },
                Similarity3 { rotation: turn(DVec3::X), ..best },
                Similarity3 { rotation: turn(DVec3::Y), ..best },
                Similarity3 { rotation: turn(DVec3::Z), ..best },
                Similarity3 { translation: best.translation + change * DVec3::ONE, ..best },
            ];
            assert!(others.iter().all(|other| cost(other) > cost(&best)));
        }
    }

    #[test]
    fn outliers_do_not_move_the_robust_motion() {
        let a = cloud(60);
        let mut b: Vec<_> = a.iter().map(|&p| truth().transform_point(p)).collect();
        for (i, p) in b.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
            *p += DVec3::new(5.0 + i as f64, -3.0, 2.0);
        }
        let options = RobustAlignment { max_distance: 0.01, trials: 100, seed: 1 };
        let (motion, mask) = align_robust(&a, &b, &options).expect("40 inliers");
        assert!(distance(&motion, &truth()) < 1e-12);
        assert!(mask.iter().enumerate().all(|(i, &inlier)| inlier == (i % 3 != 0)));
    }

    #[test]
    fn too_few_or_broken_points_have_no_motion() {
        let a = cloud(3);
        assert_eq!(align_similarity(&a[..2], &a[..2]), None);
        assert_eq!(align_similarity(&a, &a[..2]), None);
        assert_eq!(align_similarity(&[a[0], a[1], DVec3::NAN], &a), None);
        assert_eq!(align_rigid(&[DVec3::ZERO; 3], &[DVec3::ONE; 3]).map(|m| m.scale), Some(1.0));
    }
}
