//! The fundamental matrix from seven correspondences.
//!
//! Source: R. Hartley and A. Zisserman, "Multiple View Geometry", 2nd edition, §11.1.2.

use glam::{DMat3, DVec2};

use super::five_point::{epipolar_row, row_major};
use super::null_space;
use super::polynomial::real_roots;

/// Appends to `solutions` the matrices F (one or three, of unit Frobenius norm and zero determinant) with
/// `(x2, 1)ᵀ F (x1, 1) = 0` for seven pairs of points. The points should be centred and of order one.
///
/// Nothing is appended where the pairs leave more than two directions open or are not finite.
pub fn seven_point(points1: &[DVec2; 7], points2: &[DVec2; 7], solutions: &mut Vec<DMat3>) {
    let rows: [[f64; 9]; 7] = std::array::from_fn(|i| epipolar_row(points1[i].extend(1.0), points2[i].extend(1.0)));
    let Some(basis) = null_space::minimal::<7, 2>(&rows) else { return };
    let (a, b) = (row_major(&basis[0]), row_major(&basis[1]));
    // det(λ A + B): the coefficients by columns, as the determinant is linear in each.
    let triple = |x: [&DMat3; 3]| x[0].x_axis.dot(x[1].y_axis.cross(x[2].z_axis));
    let cubic = [
        triple([&b, &b, &b]),
        triple([&a, &b, &b]) + triple([&b, &a, &b]) + triple([&b, &b, &a]),
        triple([&a, &a, &b]) + triple([&a, &b, &a]) + triple([&b, &a, &a]),
        triple([&a, &a, &a]),
    ];
    for &lambda in real_roots(&cubic).as_slice() {
        let f = (a * lambda + b) * (1.0 / (1.0 + lambda * lambda).sqrt());
        if f.is_finite() {
            solutions.push(f);
        }
    }
}
