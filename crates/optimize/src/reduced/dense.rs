//! Dense Cholesky of the reduced matrix, tiled so that it runs on all cores and gives the same bytes on any number.

use std::sync::Arc;

use faer::linalg::cholesky::llt;
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::*;
use faer::{Accum, MatMut, Par};

use super::cholesky::NotPositiveDefinite;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use crate::lm::{Observer, breath};
use crate::parallel;

/// Columns that are factorised at a time: enough for each pass over the rest of the matrix to be worth its traffic.
const PANEL: usize = 128;
/// Side of the tiles that one thread updates at a time: 0.5 MB, which stays in its cache.
const TILE: usize = 256;
/// Columns that one thread loads at a time.
const LOAD_BLOCKS: usize = 8;

/// A dense factor and its memory.
#[derive(Debug)]
pub(super) struct DenseCholesky {
    dim: usize,
    /// Column-major; the lower triangle counts.
    factor: Vec<f64>,
}

impl DenseCholesky {
    pub(super) fn new(pattern: &Arc<BlockPattern>) -> Self {
        Self { dim: pattern.layout().dim(), factor: Vec::new() }
    }

    pub(super) fn flops(&self) -> f64 {
        (self.dim as f64).powi(3) / 3.0
    }

    pub(super) async fn solve(
        &mut self,
        matrix: &BlockMatrix,
        rhs: &[f64],
        observer: &mut dyn Observer,
    ) -> Result<Vec<f64>, NotPositiveDefinite> {
        let n = self.dim;
        let mut x = rhs.to_vec();
        if n == 0 {
            return Ok(x);
        }
        self.load(matrix);
        let mut view = MatMut::from_column_major_slice_mut(&mut self.factor, n, n);
        factorize(view.rb_mut(), observer).await?;
        let scratch = llt::solve::solve_in_place_scratch::<f64>(n, 1, Par::Seq);
        let mut memory = faer::dyn_stack::MemBuffer::new(scratch);
        let rhs = MatMut::from_column_major_slice_mut(&mut x, n, 1);
        llt::solve::solve_in_place(view.rb(), rhs, Par::Seq, faer::dyn_stack::MemStack::new(&mut memory));
        Ok(x)
    }

    /// The stored upper blocks are rows of the upper triangle, hence columns of the lower one.
    fn load(&mut self, matrix: &BlockMatrix) {
        let n = self.dim;
        self.factor.resize(n * n, 0.0);
        let pattern = matrix.pattern();
        let layout = pattern.layout();
        let blocks = layout.num_blocks();
        let groups: Vec<usize> = (0..blocks).step_by(LOAD_BLOCKS).chain([blocks]).collect();
        let offsets: Vec<usize> = groups.iter().map(|&b| layout.range_start(b) * n).collect();
        let mut pieces = parallel::split_mut(&mut self.factor, &offsets);
        parallel::for_each_mut(&mut pieces, |g, piece| {
            let first = layout.range_start(groups[g]);
            for i in groups[g]..groups[g + 1] {
                for (k, row) in layout.range(i).enumerate() {
                    let line = &mut piece[(row - first) * n..(row - first + 1) * n];
                    line[row..].fill(0.0);
                    for slot in pattern.row(i) {
                        let columns = layout.range(pattern.column(slot));
                        let from = pattern.value_offset(slot) + k * layout.stride(pattern.column(slot));
                        line[columns.clone()].copy_from_slice(&matrix.values[from..from + columns.len()]);
                    }
                }
            }
        });
    }
}

/// Right-looking: factorise a panel, then take it off all that is to its right, tile by tile. Tiles do not depend on
/// the number of threads, and each is written by one.
async fn factorize(mut rest: MatMut<'_, f64>, observer: &mut dyn Observer) -> Result<(), NotPositiveDefinite> {
    let scratch = llt::factor::cholesky_in_place_scratch::<f64>(PANEL, Par::Seq, Default::default());
    let mut memory = faer::dyn_stack::MemBuffer::new(scratch);
    while rest.nrows() > 0 {
        let width = PANEL.min(rest.nrows());
        let (mut top, _, mut below, mut right) = rest.split_at_mut(width, width);
        let stack = faer::dyn_stack::MemStack::new(&mut memory);
        llt::factor::cholesky_in_place(top.rb_mut(), Default::default(), Par::Seq, stack, Default::default())
            .map_err(|_| NotPositiveDefinite)?;
        let top = top.rb();
        let mut pieces = split_rows(below.rb_mut(), PANEL);
        parallel::for_each_mut(&mut pieces, |_, piece| {
            solve_lower_triangular_in_place(top, piece.rb_mut().transpose_mut(), Par::Seq);
        });
        drop(pieces);
        subtract_square(below.rb(), right.rb_mut());
        rest = right;
        breath(observer).await;
    }
    Ok(())
}

/// `right −= below belowᵀ`, lower triangle.
fn subtract_square(below: MatRef<'_, f64>, right: MatMut<'_, f64>) {
    let mut tiles = Vec::new();
    let (mut rest, mut from) = (right, 0);
    while rest.ncols() > 0 {
        let width = TILE.min(rest.ncols());
        let (column, next) = rest.split_at_col_mut(width);
        let (_, column) = column.split_at_row_mut(from);
        let rows = split_rows(column, TILE);
        tiles.extend(rows.into_iter().enumerate().map(|(k, tile)| (from, from + k * TILE, tile)));
        from += width;
        rest = next;
    }
    parallel::for_each_mut(&mut tiles, |_, (column, row, tile)| {
        let left = below.subrows(*row, tile.nrows());
        let upper = below.subrows(*column, tile.ncols());
        let shape = if row == column { BlockStructure::TriangularLower } else { BlockStructure::Rectangular };
        let full = BlockStructure::Rectangular;
        matmul(tile.rb_mut(), shape, Accum::Add, left, full, upper.transpose(), full, -1.0, Par::Seq);
    });
}

fn split_rows(mut rest: MatMut<'_, f64>, height: usize) -> Vec<MatMut<'_, f64>> {
    let mut pieces = Vec::with_capacity(rest.nrows().div_ceil(height));
    while rest.nrows() > height {
        let (piece, next) = rest.split_at_row_mut(height);
        pieces.push(piece);
        rest = next;
    }
    if rest.nrows() > 0 {
        pieces.push(rest);
    }
    pieces
}
