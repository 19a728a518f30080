//! Singular values of a 3 × 3 matrix to full relative accuracy.
//!
//! Working on A itself rather than on AᵀA keeps the small singular value of an essential matrix at rounding level.
//! Source: G. Golub and C. Van Loan, "Matrix Computations", 4th edition, §8.6.3 (one-sided Jacobi).

use glam::{DMat3, DVec3};

/// `(U, s, V)` with `A = U diag(s) Vᵀ`, U and V orthogonal and s descending; `None` where A is not finite or zero.
pub(super) fn svd3(matrix: &DMat3) -> Option<(DMat3, DVec3, DMat3)> {
    let mut a = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let mut v = [DVec3::X, DVec3::Y, DVec3::Z];
    let size = a.iter().fold(0.0_f64, |m, c| m.max(c.abs().max_element()));
    if !matrix.is_finite() || size <= 0.0 {
        return None;
    }
    a = a.map(|c| c / size);
    // Convergence is quadratic; six sweeps are the most ever seen on 3 × 3.
    for _ in 0..16 {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (pp, qq, pq) = (a[p].length_squared(), a[q].length_squared(), a[p].dot(a[q]));
            if pq.abs() <= 1e-16 * (pp * qq).sqrt() || pq == 0.0 {
                continue;
            }
            rotated = true;
            let tau = (qq - pp) / (2.0 * pq);
            let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
            let c = 1.0 / (1.0 + t * t).sqrt();
            let s = c * t;
            (a[p], a[q]) = (a[p] * c - a[q] * s, a[p] * s + a[q] * c);
            (v[p], v[q]) = (v[p] * c - v[q] * s, v[p] * s + v[q] * c);
        }
        if !rotated {
            break;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j].length_squared().total_cmp(&a[i].length_squared()));
    let (a, v) = (order.map(|i| a[i]), order.map(|i| v[i]));
    let u0 = a[0].normalize();
    // Columns at rounding level have no direction of their own: complete the basis.
    let rejected = a[1] - u0 * u0.dot(a[1]);
    let u1 = if rejected.length() > 1e-15 { rejected.normalize() } else { u0.any_orthonormal_vector() };
    let cross = u0.cross(u1);
    let u2 = if cross.dot(a[2]) < 0.0 { -cross } else { cross };
    let values = DVec3::new(a[0].length(), a[1].length(), a[2].length()) * size;
    Some((DMat3::from_cols(u0, u1, u2), values, DMat3::from_cols(v[0], v[1], v[2])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn largest(m: DMat3) -> f64 {
        m.to_cols_array().iter().fold(0.0, |a, x| a.max(x.abs()))
    }

    #[test]
    fn ranks_below_three_are_completed() {
        let a = DVec3::new(1.0, -2.0, 0.5);
        let rank_one = DMat3::from_cols(a, a * 2.0, a * -1.0);
        let (u, s, v) = svd3(&rank_one).expect("finite");
        assert!(s.y < 1e-15 && s.z < 1e-15);
        assert!(largest(u.transpose() * u - DMat3::IDENTITY) < 1e-14);
        assert!(largest(u * DMat3::from_diagonal(s) * v.transpose() - rank_one) < 1e-14);
        assert!(svd3(&DMat3::ZERO).is_none());
        assert!(svd3(&DMat3::from_diagonal(DVec3::new(1.0, f64::NAN, 1.0))).is_none());
    }

    proptest! {
        #[test]
        fn factors_reproduce_the_matrix(m in proptest::array::uniform9(-10.0f64..10.0)) {
            let a = DMat3::from_cols_array(&m);
            prop_assume!(largest(a) > 0.0);
            let (u, s, v) = svd3(&a).expect("finite");
            prop_assert!(largest(u * DMat3::from_diagonal(s) * v.transpose() - a) < 1e-13 * (1.0 + largest(a)));
            prop_assert!(largest(u.transpose() * u - DMat3::IDENTITY) < 1e-13);
            prop_assert!(largest(v.transpose() * v - DMat3::IDENTITY) < 1e-13);
            prop_assert!(s.x >= s.y && s.y >= s.z);
        }
    }
}
