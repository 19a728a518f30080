//! The values of a symmetric block-sparse matrix.

use std::sync::Arc;

use super::pattern::BlockPattern;

/// A symmetric matrix: the upper block triangle, each block row-major with padded rows. Diagonal blocks are stored in
/// full and are symmetric.
#[derive(Clone, Debug)]
pub struct BlockMatrix {
    pattern: Arc<BlockPattern>,
    pub(super) values: Vec<f64>,
    /// Memory of the assembly, kept from one to the next.
    pub(super) factors: Vec<f64>,
}

impl BlockMatrix {
    /// All zero.
    pub fn zeros(pattern: Arc<BlockPattern>) -> Self {
        let values = vec![0.0; pattern.num_values()];
        Self { pattern, values, factors: Vec::new() }
    }

    /// The sparsity.
    pub fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    /// Sets every value to zero.
    pub fn fill_zero(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds a row-major `size_i × size_j` block at `(i, j)`, `i ≤ j`. Blocks that are not in the pattern are left out:
    /// with a diagonal pattern only the diagonal is kept. A diagonal block must be symmetric.
    pub fn add_to_block(&mut self, i: usize, j: usize, block: &[f64]) {
        let Some(slot) = self.pattern.find(i, j) else { return };
        let layout = self.pattern.layout();
        let (columns, stride) = (layout.size(j), layout.stride(j));
        if columns == 0 {
            return;
        }
        let start = self.pattern.value_offset(slot);
        for (row, values) in block.chunks_exact(columns).enumerate() {
            let at = start + row * stride;
            self.values[at..at + columns].iter_mut().zip(values).for_each(|(a, b)| *a += b);
        }
    }

    /// Adds the same number to every diagonal element.
    pub fn add_to_diagonal(&mut self, value: f64) {
        self.for_each_diagonal(|d| *d += value);
    }

    /// Adds one number to each diagonal element.
    pub fn add_diagonal(&mut self, values: &[f64]) {
        let mut values = values.iter();
        self.for_each_diagonal(|d| *d += values.next().copied().unwrap_or(0.0));
    }

    /// Takes unknowns out: their rows and columns become 0 with 1 on the diagonal, so that their step is 0 where their
    /// right-hand side is, and all others are solved for as if they were not there.
    pub fn remove_unknowns(&mut self, removed: &[bool]) {
        if !removed.contains(&true) {
            return;
        }
        let layout = self.pattern.layout();
        for i in 0..layout.num_blocks() {
            for slot in self.pattern.row(i) {
                let j = self.pattern.column(slot);
                let start = self.pattern.value_offset(slot);
                for (k, row) in layout.range(i).enumerate() {
                    for (l, column) in layout.range(j).enumerate() {
                        if removed[row] || removed[column] {
                            self.values[start + k * layout.stride(j) + l] = f64::from(u8::from(row == column));
                        }
                    }
                }
            }
        }
    }

    /// Puts 1 on the diagonal where it is exactly 0 (a column without any active observation), so that the factor
    /// exists and the step of that unknown is 0 where its right-hand side is.
    pub fn replace_empty_columns_by_identity(&mut self) {
        self.for_each_diagonal(|d| {
            if *d == 0.0 {
                *d = 1.0;
            }
        });
    }

    fn for_each_diagonal(&mut self, mut f: impl FnMut(&mut f64)) {
        let layout = self.pattern.layout();
        for i in 0..layout.num_blocks() {
            let start = self.pattern.value_offset(self.pattern.row(i).start);
            for k in 0..layout.size(i) {
                f(&mut self.values[start + k * (layout.stride(i) + 1)]);
            }
        }
    }

    /// Element `(row, column)` of block `(i, j)`, `i ≤ j`; 0 where the block is not stored.
    pub fn get(&self, i: usize, j: usize, row: usize, column: usize) -> f64 {
        match self.pattern.find(i, j) {
            Some(slot) => self.values[self.pattern.value_offset(slot) + row * self.pattern.layout().stride(j) + column],
            None => 0.0,
        }
    }

    /// `out = A x`.
    pub fn multiply(&self, x: &[f64], out: &mut [f64]) {
        let layout = self.pattern.layout();
        out.fill(0.0);
        for i in 0..layout.num_blocks() {
            let rows = layout.range(i);
            for slot in self.pattern.row(i) {
                let j = self.pattern.column(slot);
                let (columns, stride) = (layout.range(j), layout.stride(j));
                let start = self.pattern.value_offset(slot);
                for (k, row) in rows.clone().enumerate() {
                    let values = &self.values[start + k * stride..start + k * stride + columns.len()];
                    let mut sum = 0.0;
                    for (value, column) in values.iter().zip(columns.clone()) {
                        sum += value * x[column];
                        if i != j {
                            out[column] += value * x[row];
                        }
                    }
                    out[row] += sum;
                }
            }
        }
    }
}
