//! The eigenvector of a symmetric 4 × 4 matrix that belongs to the smallest eigenvalue, without allocation.

/// Jacobi sweeps at most; convergence is quadratic and takes four or five.
const MAX_SWEEPS: usize = 30;

/// The unit eigenvector of the smallest eigenvalue by cyclic Jacobi rotations; only the lower triangle need be right.
/// `None` if a number is not finite.
pub(super) fn smallest_eigenvector(mut a: [[f64; 4]; 4]) -> Option<[f64; 4]> {
    for i in 0..4 {
        for j in 0..i {
            a[j][i] = a[i][j];
        }
    }
    if a.iter().flatten().any(|v| !v.is_finite()) {
        return None;
    }
    let trace: f64 = (0..4).map(|i| a[i][i].abs()).sum();
    // Far below the rounding with which such a matrix was summed up.
    let negligible = 1e-3 * f64::EPSILON * trace;
    // Rows of `vectors` are the eigenvectors.
    let mut vectors = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for p in 0..3 {
            for q in p + 1..4 {
                // Smaller than rounding of both diagonal entries: the rotation would change nothing.
                if a[p][q].abs() <= negligible.max(f64::EPSILON * (a[p][p] * a[q][q]).abs().sqrt()) {
                    continue;
                }
                rotated = true;
                rotate(&mut a, &mut vectors, p, q);
            }
        }
        if !rotated {
            break;
        }
    }
    let mut best = 0;
    for i in 1..4 {
        if a[i][i] < a[best][best] {
            best = i;
        }
    }
    Some(vectors[best])
}

/// One Jacobi rotation that makes `a[p][q]` zero.
#[inline(always)]
fn rotate(a: &mut [[f64; 4]; 4], vectors: &mut [[f64; 4]; 4], p: usize, q: usize) {
    let half_cotangent = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let tangent = half_cotangent.signum() / (half_cotangent.abs() + (half_cotangent * half_cotangent + 1.0).sqrt());
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let sine = tangent * cosine;
    let moved = tangent * a[p][q];
    a[p][p] -= moved;
    a[q][q] += moved;
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    for k in 0..4 {
        if k != p && k != q {
            let (kp, kq) = (a[k][p], a[k][q]);
            a[k][p] = cosine * kp - sine * kq;
            a[k][q] = sine * kp + cosine * kq;
            a[p][k] = a[k][p];
            a[q][k] = a[k][q];
        }
    }
    for k in 0..4 {
        let (vp, vq) = (vectors[p][k], vectors[q][k]);
        vectors[p][k] = cosine * vp - sine * vq;
        vectors[q][k] = sine * vp + cosine * vq;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_nalgebra() {
        let mut seed = 1u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for _ in 0..200 {
            let half = nalgebra::Matrix4::from_fn(|_, _| random());
            let full = half.transpose() * half;
            let mut rows = [[0.0; 4]; 4];
            for i in 0..4 {
                for j in 0..4 {
                    rows[i][j] = full[(i, j)];
                }
            }
            let ours = nalgebra::Vector4::from(smallest_eigenvector(rows).expect("finite"));
            let theirs = nalgebra::SymmetricEigen::new(full);
            let expected = theirs.eigenvectors.column(theirs.eigenvalues.imin()).into_owned();
            let smallest = theirs.eigenvalues.min();
            assert!((full * ours - smallest * ours).norm() < 1e-14 * full.norm());
            assert!((ours.norm() - 1.0).abs() < 1e-14 && expected.dot(&ours).abs() > 1.0 - 1e-6);
        }
        assert_eq!(smallest_eigenvector([[f64::NAN; 4]; 4]), None);
    }

    #[test]
    fn diagonal_and_zero_matrices_end() {
        let mut diagonal = [[0.0; 4]; 4];
        assert!(smallest_eigenvector(diagonal).is_some());
        for (i, value) in [3.0, 0.5, 2.0, 1.0].into_iter().enumerate() {
            diagonal[i][i] = value;
        }
        assert_eq!(smallest_eigenvector(diagonal), Some([0.0, 1.0, 0.0, 0.0]));
    }
}
