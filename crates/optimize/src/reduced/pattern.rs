//! Which blocks of the symmetric reduced matrix are stored: the upper triangle, by block rows.

use super::incidence::Incidence;
use super::layout::BlockLayout;
use crate::parallel;

/// The block sparsity of a symmetric matrix. Row `i` holds the blocks `(i, j)`, `j ≥ i`, ascending; `(i, i)` is
/// always there and first.
#[derive(Clone, Debug)]
pub struct BlockPattern {
    layout: BlockLayout,
    row_start: Vec<u32>,
    columns: Vec<u32>,
    value_start: Vec<usize>,
}

impl BlockPattern {
    /// Every pair of blocks that meet at a point.
    pub fn from_incidence(layout: &BlockLayout, incidence: &Incidence) -> Self {
        let block = incidence.all_blocks();
        let rows = parallel::map_indices(layout.num_blocks(), |i| {
            let mut met = vec![false; layout.num_blocks() - i];
            met[0] = true;
            for member in incidence.of_block(i) {
                for &j in &block[member.participant as usize..member.end as usize] {
                    met[j as usize - i] = true;
                }
            }
            let columns = met.iter().enumerate().filter(|(_, met)| **met).map(|(k, _)| (k + i) as u32);
            columns.collect::<Vec<u32>>()
        });
        Self::from_rows(layout, rows)
    }

    /// The diagonal blocks alone: what a block-Jacobi preconditioner needs.
    pub fn diagonal(layout: &BlockLayout) -> Self {
        Self::from_rows(layout, (0..layout.num_blocks() as u32).map(|i| vec![i]).collect())
    }

    fn from_rows(layout: &BlockLayout, rows: Vec<Vec<u32>>) -> Self {
        let mut row_start = vec![0u32];
        let mut columns = Vec::with_capacity(rows.iter().map(Vec::len).sum());
        let mut value_start = Vec::with_capacity(columns.capacity() + 1);
        let mut end = 0;
        for (i, row) in rows.into_iter().enumerate() {
            for j in row {
                columns.push(j);
                value_start.push(end);
                end += layout.size(i) * layout.stride(j as usize);
            }
            row_start.push(columns.len() as u32);
        }
        value_start.push(end);
        Self { layout: layout.clone(), row_start, columns, value_start }
    }

    /// The blocks' sizes.
    pub fn layout(&self) -> &BlockLayout {
        &self.layout
    }

    /// Slots of a block row: indices into [`Self::column`] and [`Self::value_offset`].
    pub fn row(&self, block: usize) -> std::ops::Range<usize> {
        self.row_start[block] as usize..self.row_start[block + 1] as usize
    }

    /// The block column of a slot.
    pub fn column(&self, slot: usize) -> usize {
        self.columns[slot] as usize
    }

    /// The slot of block `(i, j)`, `i ≤ j`, if stored.
    pub fn find(&self, i: usize, j: usize) -> Option<usize> {
        let row = self.row(i);
        self.columns[row.clone()].binary_search(&(j as u32)).ok().map(|k| row.start + k)
    }

    /// Where the values of a slot begin: `size(i)` rows of `stride(j)` scalars.
    pub fn value_offset(&self, slot: usize) -> usize {
        self.value_start[slot]
    }

    /// Number of stored scalars, padding included.
    pub fn num_values(&self) -> usize {
        self.value_start[self.columns.len()]
    }

    /// Stored blocks over the blocks of a full upper triangle.
    pub fn density(&self) -> f64 {
        let n = self.layout.num_blocks() as f64;
        if n == 0.0 { 1.0 } else { self.columns.len() as f64 / (0.5 * n * (n + 1.0)) }
    }
}
