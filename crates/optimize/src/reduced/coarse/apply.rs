//! `z += Z A⁻¹ Zᵀ r`.

use super::modes::Basis;
use crate::reduced::BlockLayout;

/// The second level, ready to be applied.
#[derive(Clone, Debug)]
pub(crate) struct CoarseSpace {
    basis: Basis,
    /// Row-major.
    inverse: Vec<f64>,
}

impl CoarseSpace {
    /// From `Z` and `A⁻¹` (row-major).
    pub(crate) fn new(basis: Basis, inverse: Vec<f64>) -> Self {
        Self { basis, inverse }
    }

    /// Adds the coarse correction of a residual.
    pub(crate) fn add_to(&self, layout: &BlockLayout, r: &[f64], z: &mut [f64]) {
        let dim = self.basis.dim;
        let mut restricted = vec![0.0; dim];
        for (block, columns) in self.basis.of_block.iter().enumerate() {
            for part in columns {
                let out = &mut restricted[part.first..part.first + part.count];
                for (r, row) in r[layout.range(block)].iter().zip(part.values.chunks_exact(part.count)) {
                    out.iter_mut().zip(row).for_each(|(out, z)| *out += r * z);
                }
            }
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let y: Vec<f64> = self.inverse.chunks_exact(dim.max(1)).map(|row| dot(row, &restricted)).collect();
        for (block, columns) in self.basis.of_block.iter().enumerate() {
            for part in columns {
                let y = &y[part.first..part.first + part.count];
                for (z, row) in z[layout.range(block)].iter_mut().zip(part.values.chunks_exact(part.count)) {
                    *z += dot(row, y);
                }
            }
        }
    }
}
