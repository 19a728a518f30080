//! Homographies between directions: exact from four pairs, least squares from more.
//!
//! Rays of any length serve, so that one solver covers image points `(x, y, 1)` and the bearings of any camera model.
//! Source: R. Hartley and A. Zisserman, "Multiple View Geometry", 2nd edition, §4.1.

use glam::{DMat3, DVec3};

use super::eight_point::unit_norm;
use super::normalize::whitening;
use super::null_space::Gram;

/// The homography H with `H ray1 ∝ ray2` for four pairs, of unit Frobenius norm, by the two projective bases.
///
/// `None` where three of the four directions of an image lie in one plane through the camera (collinear points), where
/// H would mirror the scene (no camera does), or where a ray is not finite.
pub fn homography_four_point(rays1: &[DVec3; 4], rays2: &[DVec3; 4]) -> Option<DMat3> {
    let (basis1, weights1) = projective_basis(rays1)?;
    let (basis2, weights2) = projective_basis(rays2)?;
    // A plane that both cameras see from one side: positive depths of all four rays, and no mirror image.
    let depths = weights2 / weights1;
    if depths.min_element() <= 0.0 || basis1.determinant() * basis2.determinant() <= 0.0 {
        return None;
    }
    unit_norm(basis2 * DMat3::from_diagonal(depths) * basis1.inverse())
}

/// The first three rays as columns, and the fourth ray in their coordinates.
fn projective_basis(rays: &[DVec3; 4]) -> Option<(DMat3, DVec3)> {
    let unit = rays.map(DVec3::normalize_or_zero);
    let basis = DMat3::from_cols(unit[0], unit[1], unit[2]);
    // Three collinear points within 1e-6 of a radian squared carry no homography.
    const SMALLEST_VOLUME: f64 = 1e-12;
    let volume = basis.determinant();
    if volume.is_nan() || volume.abs() < SMALLEST_VOLUME {
        return None;
    }
    let weights = basis.inverse() * unit[3];
    (weights.is_finite() && weights.abs().min_element() > 1e-9).then_some((basis, weights))
}

/// The homography H with `H ray1 ∝ ray2` that minimises the algebraic error over at least four pairs of rays.
///
/// `None` for fewer than four pairs, for lists of unequal length and where the pairs do not fix H.
pub fn homography_least_squares(rays1: &[DVec3], rays2: &[DVec3]) -> Option<DMat3> {
    if rays1.len() < 4 || rays1.len() != rays2.len() {
        return None;
    }
    let (t1, t2) = (whitening(rays1)?, whitening(rays2)?);
    let mut gram = Gram::ZERO;
    for (&p, &q) in rays1.iter().zip(rays2) {
        let (p, q) = (t1 * p, (t2 * q).normalize_or_zero());
        // Two directions across q: along them H p must vanish.
        let (a, b) = q.any_orthonormal_pair();
        for direction in [a, b] {
            let (x, y, z) = (p * direction.x, p * direction.y, p * direction.z);
            gram.add(&[x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z]);
        }
    }
    let h = super::five_point::row_major(&gram.smallest()?);
    unit_norm(t2.inverse() * h * t1)
}
