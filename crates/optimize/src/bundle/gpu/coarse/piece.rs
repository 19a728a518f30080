//! The index of one piece of points: what each point has to do with which row of blocks, and who sums it.

use super::plan::{Piece, Plan};
use crate::bundle::gpu::chunk::Chunk;

/// Entries of one row that one workgroup pairs.
const SEGMENT: usize = 256;
/// `NO_ENTRY` in `coarse.wgsl`.
const NO_ENTRY: u32 = u32::MAX;

/// Largest sizes over all pieces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in super::super) struct Limits {
    pub(in super::super) entries: usize,
    pub(super) words: usize,
    pub(in super::super) segments: usize,
    /// Blocks of partial sums.
    pub(super) partials: usize,
}

impl Limits {
    pub(super) fn max(self, other: Self) -> Self {
        Self {
            entries: self.entries.max(other.entries),
            words: self.words.max(other.words),
            segments: self.segments.max(other.segments),
            partials: self.partials.max(other.partials),
        }
    }
}

/// As `coarse.wgsl` declares them.
#[derive(Debug)]
pub(in super::super) struct PieceWords {
    /// `CoarseEntry`.
    pub(in super::super) entries: Vec<[u32; 8]>,
    pub(super) words: Vec<u32>,
    segments: usize,
    partials: usize,
}

impl PieceWords {
    pub(in super::super) fn new(plan: &Plan, chunk: &Chunk, piece: &Piece) -> Self {
        let mut entries: Vec<[u32; 8]> = Vec::new();
        let mut by_row: Vec<Vec<u32>> = vec![Vec::new(); plan.rows()];
        let mut rows = Vec::new();
        for point in piece.points.clone() {
            plan.rows_of(chunk, point, &mut rows);
            let end = (entries.len() + rows.len()) as u32;
            for &row in &rows {
                by_row[row as usize].push(entries.len() as u32);
                let (camera, kind) = plan.camera_of_row(row as usize).map_or((0, 0), |(c, eighth)| (c, 1 + eighth));
                let track = [chunk.tracks[point], chunk.tracks[point + 1]];
                entries.push([point as u32, row, end, kind, track[0], track[1], camera, 0]);
            }
        }
        let (mut first_segment, mut segments, mut out) = (vec![0], Vec::new(), 0);
        let mut start = 0;
        for (row, sorted) in by_row.iter().enumerate() {
            let (first, last) = (plan.row_start[row], plan.row_start[row + 1]);
            for from in (0..sorted.len()).step_by(SEGMENT) {
                let to = sorted.len().min(from + SEGMENT);
                segments.push([first, last - first, (start + from) as u32, (start + to) as u32, out]);
                out += last - first;
            }
            start += sorted.len();
            first_segment.push(segments.len() as u32);
        }
        let mut words = vec![segments.len() as u32, plan.rows() as u32];
        words.extend(first_segment);
        words.extend(segments.iter().flatten());
        words.extend(by_row.into_iter().flatten());
        Self { entries, words, segments: segments.len(), partials: out as usize }
    }

    pub(super) fn limits(&self) -> Limits {
        Limits {
            entries: self.entries.len(),
            words: self.words.len(),
            segments: self.segments,
            partials: self.partials,
        }
    }

    /// Rows and sorted entries of the segments.
    #[cfg(test)]
    pub(in super::super) fn segments(&self) -> impl Iterator<Item = (u32, &[u32])> {
        let at = 3 + self.words[1] as usize;
        let sorted = &self.words[at + 5 * self.segments..];
        self.words[at..at + 5 * self.segments].chunks_exact(5).map(move |s| {
            let entries = &sorted[s[2] as usize..s[3] as usize];
            (self.entries[entries[0] as usize][1], entries)
        })
    }

    /// Fills up to so many entries with such that nobody computes.
    pub(in super::super) fn pad(&mut self, entries: usize) {
        self.entries.resize(entries, [NO_ENTRY, 0, 0, 0, 0, 0, 0, 0]);
    }
}
