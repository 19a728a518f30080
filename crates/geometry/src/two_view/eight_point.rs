//! Epipolar matrices from eight or more correspondences, by linear least squares.
//!
//! Source: R. Hartley, "In defense of the eight-point algorithm", PAMI 1997.

use glam::{DMat3, DVec2, DVec3};

use super::five_point::{epipolar_row, row_major};
use super::normalize::{isotropic, whitening};
use super::null_space::Gram;
use super::svd::svd3;

/// The fundamental matrix F with `(x2, 1)ᵀ F (x1, 1) ≈ 0` for at least eight pairs of points, of unit Frobenius norm
/// and zero determinant. The points are normalised inside (centroid at the origin, mean distance √2).
///
/// `None` for fewer than eight pairs, for lists of unequal length and where the pairs do not fix F (as for points of
/// one plane without noise).
pub fn eight_point_fundamental(points1: &[DVec2], points2: &[DVec2]) -> Option<DMat3> {
    if points1.len() < 8 || points1.len() != points2.len() {
        return None;
    }
    let (t1, t2) = (isotropic(points1)?, isotropic(points2)?);
    let mut gram = Gram::ZERO;
    for (p, q) in points1.iter().zip(points2) {
        gram.add(&epipolar_row(t1 * p.extend(1.0), t2 * q.extend(1.0)));
    }
    let (u, s, v) = svd3(&row_major(&gram.smallest()?))?;
    let rank_two = u * DMat3::from_diagonal(DVec3::new(s.x, s.y, 0.0)) * v.transpose();
    unit_norm(t2.transpose() * rank_two * t1)
}

/// The essential matrix E with `ray2ᵀ E ray1 ≈ 0` for at least eight pairs of rays, with singular values (1, 1, 0).
///
/// `None` for fewer than eight pairs, for lists of unequal length and where the pairs do not fix E.
pub fn eight_point_essential(rays1: &[DVec3], rays2: &[DVec3]) -> Option<DMat3> {
    if rays1.len() < 8 || rays1.len() != rays2.len() {
        return None;
    }
    let (t1, t2) = (whitening(rays1)?, whitening(rays2)?);
    let mut gram = Gram::ZERO;
    for (&p, &q) in rays1.iter().zip(rays2) {
        gram.add(&epipolar_row(t1 * p, t2 * q));
    }
    closest_essential(&(t2.transpose() * row_major(&gram.smallest()?) * t1))
}

/// The essential matrix closest to `matrix` up to scale: singular values (1, 1, 0).
pub fn closest_essential(matrix: &DMat3) -> Option<DMat3> {
    let (u, s, v) = svd3(matrix)?;
    if s.y <= f64::MIN_POSITIVE {
        return None;
    }
    Some(u * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)) * v.transpose())
}

/// The matrix with unit Frobenius norm.
pub(super) fn unit_norm(m: DMat3) -> Option<DMat3> {
    let norm = (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt();
    let scaled = m * (1.0 / norm);
    (norm > 0.0 && scaled.is_finite()).then_some(scaled)
}
