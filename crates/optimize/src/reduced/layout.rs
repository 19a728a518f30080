//! Where each block of unknowns lies in the vectors of the reduced system.

/// Columns of stored blocks are padded to this many scalars, so that a row is whole SIMD registers (4 × f64 = AVX2).
const LANE: usize = 4;

/// Sizes and offsets of the blocks of unknowns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockLayout {
    sizes: Vec<u32>,
    offsets: Vec<u32>,
    factor_stride: usize,
}

impl BlockLayout {
    /// A layout of consecutive blocks. A block of size 0 has no unknowns and may not take part in any point.
    pub fn new(sizes: Vec<usize>) -> Self {
        let mut offsets = Vec::with_capacity(sizes.len() + 1);
        let mut offset = 0u32;
        offsets.push(0);
        for &size in &sizes {
            offset += size as u32;
            offsets.push(offset);
        }
        let largest = sizes.iter().copied().max().unwrap_or(0);
        Self {
            sizes: sizes.into_iter().map(|s| s as u32).collect(),
            offsets,
            factor_stride: largest.next_multiple_of(LANE),
        }
    }

    /// Number of blocks.
    pub fn num_blocks(&self) -> usize {
        self.sizes.len()
    }

    /// Number of scalar unknowns.
    pub fn dim(&self) -> usize {
        self.offsets[self.sizes.len()] as usize
    }

    /// Number of unknowns of a block.
    pub fn size(&self, block: usize) -> usize {
        self.sizes[block] as usize
    }

    /// First unknown of a block.
    pub fn offset(&self, block: usize) -> usize {
        self.offsets[block] as usize
    }

    /// As [`Self::offset`], and the number of unknowns for the block after the last.
    pub(super) fn range_start(&self, block: usize) -> usize {
        self.offsets[block] as usize
    }

    /// The unknowns of a block.
    pub fn range(&self, block: usize) -> std::ops::Range<usize> {
        self.offset(block)..self.offset(block + 1)
    }

    /// Scalars from one row of a stored block to the next, when `block` is the column.
    pub fn stride(&self, block: usize) -> usize {
        self.size(block).next_multiple_of(LANE)
    }

    /// Scalars from one row of a participant's factor `Eᵀ` (3 rows) to the next: the same for all blocks.
    pub fn factor_stride(&self) -> usize {
        self.factor_stride
    }
}
