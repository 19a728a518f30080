//! Null spaces of the 9-column systems that every epipolar and homography solver builds.

use nalgebra::{SMatrix, SymmetricEigen};

/// An orthonormal basis of the null space of `M` rows of nine numbers, `K = 9 − M` vectors.
///
/// Householder reflections of the transposed system: its last columns of Q. `None` where a row depends on the others.
pub(super) fn minimal<const M: usize, const K: usize>(rows: &[[f64; 9]; M]) -> Option<[[f64; 9]; K]> {
    const { assert!(M + K == 9) };
    let mut a = *rows;
    let mut reflectors = [[0.0; 9]; M];
    for j in 0..M {
        let scale = rows[j].iter().map(|x| x * x).sum::<f64>().sqrt();
        let norm = a[j][j..].iter().map(|x| x * x).sum::<f64>().sqrt();
        // A row whose part outside the span of the earlier ones is rounding noise repeats them.
        if !norm.is_finite() || norm <= 1e-13 * scale {
            return None;
        }
        let v = &mut reflectors[j];
        v[j..].copy_from_slice(&a[j][j..]);
        v[j] += if v[j] < 0.0 { -norm } else { norm };
        let length = v[j..].iter().map(|x| x * x).sum::<f64>().sqrt();
        for x in &mut v[j..] {
            *x /= length;
        }
        for row in &mut a[j + 1..] {
            reflect(v, row, j);
        }
    }
    let mut basis = [[0.0; 9]; K];
    for (k, vector) in basis.iter_mut().enumerate() {
        vector[M + k] = 1.0;
        for j in (0..M).rev() {
            reflect(&reflectors[j], vector, j);
        }
    }
    Some(basis)
}

#[inline(always)]
fn reflect(v: &[f64; 9], x: &mut [f64; 9], from: usize) {
    let dot: f64 = (from..9).map(|i| v[i] * x[i]).sum();
    for i in from..9 {
        x[i] -= 2.0 * dot * v[i];
    }
}

/// Sums rows of an overdetermined homogeneous system as its 9 × 9 Gram matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gram {
    upper: [[f64; 9]; 9],
}

impl Gram {
    pub(super) const ZERO: Self = Self { upper: [[0.0; 9]; 9] };

    #[inline]
    pub(super) fn add(&mut self, row: &[f64; 9]) {
        for i in 0..9 {
            for j in i..9 {
                self.upper[i][j] += row[i] * row[j];
            }
        }
    }

    /// The unit vector that minimises the sum of squares, or `None` where the system leaves more than one direction
    /// open (the second-smallest eigenvalue vanishes too).
    pub(super) fn smallest(&self) -> Option<[f64; 9]> {
        let matrix = SMatrix::<f64, 9, 9>::from_fn(|i, j| self.upper[i.min(j)][i.max(j)]);
        if !matrix.iter().all(|x| x.is_finite()) {
            return None;
        }
        let eigen = SymmetricEigen::try_new(matrix, 1e-15, 1000)?;
        let mut order: [usize; 9] = std::array::from_fn(|i| i);
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        // Squared singular values: 1e-14 is a relative singular value of 1e-7, at which the vector is noise.
        if eigen.eigenvalues[order[1]] <= 1e-14 * eigen.eigenvalues[order[8]] {
            return None;
        }
        let column = eigen.eigenvectors.column(order[0]);
        Some(std::array::from_fn(|i| column[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minimal_basis_is_orthonormal_and_orthogonal_to_the_rows() {
        let rows: [[f64; 9]; 5] =
            std::array::from_fn(|i| std::array::from_fn(|j| ((i * 9 + j).pow(2) as f64 * 1.7).sin()));
        let basis: [[f64; 9]; 4] = minimal(&rows).expect("independent rows");
        let dot = |a: &[f64; 9], b: &[f64; 9]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        for (k, b) in basis.iter().enumerate() {
            assert!(rows.iter().all(|r| dot(r, b).abs() < 1e-14));
            for (l, c) in basis.iter().enumerate() {
                assert!((dot(b, c) - f64::from(u8::from(k == l))).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn repeated_rows_have_no_minimal_basis() {
        let mut rows: [[f64; 9]; 7] = std::array::from_fn(|i| std::array::from_fn(|j| ((i * 9 + j) as f64).cos()));
        rows[6] = rows[2];
        assert!(minimal::<7, 2>(&rows).is_none());
        rows[3] = [f64::NAN; 9];
        assert!(minimal::<7, 2>(&rows).is_none());
    }
}
