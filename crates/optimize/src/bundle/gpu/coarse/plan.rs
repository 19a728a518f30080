//! What the coarse matrix is made of, known before anything is solved: rows of 8 × 8 blocks, which blocks are kept, and the
//! pieces of points that are summed at a time.

use std::ops::Range;

use super::super::chunk::Chunk;
use super::piece::{Limits, PieceWords};
use crate::reduced::coarse::{MAX_MEMBERSHIPS, Memberships};

/// Rows and columns of a block: the seven similarities and one empty, or eight parameters.
pub(super) const BLOCK: usize = 8;
/// `NO_CLUSTER` in `modes.wgsl`.
const NO_CLUSTER: u32 = u32::MAX;
/// Pieces that the points are cut into: a sixteenth of the index stays small beside the observations.
const PIECES: usize = 16;
/// Entries of a piece: fewer leave a device idle, more need not be resident at once (8 MB).
const PIECE_ENTRIES: Range<usize> = 4096..65_536;

/// A run of points of one chunk.
#[derive(Clone, Debug)]
pub(in super::super) struct Piece {
    pub(in super::super) chunk: usize,
    pub(super) points: Range<usize>,
}

/// See the module.
#[derive(Debug)]
pub(in super::super) struct Plan {
    pub(super) memberships: Memberships,
    image_camera: Vec<u32>,
    /// Rows of a camera with an exact block: its parameters by eights.
    eighths: usize,
    pub(in super::super) clusters: usize,
    /// Cameras with an exact block, whose rows come after the clusters'.
    pub(super) cameras: Vec<u32>,
    /// Blocks of each row: `row_start[r]..row_start[r + 1]`.
    pub(super) row_start: Vec<u32>,
    /// Row and column, by rows, columns ascending from the row's own.
    pub(in super::super) blocks: Vec<(u32, u32)>,
    pub(in super::super) pieces: Vec<Piece>,
    pub(in super::super) limits: Limits,
}

impl Plan {
    /// `cameras` have an exact block; each has `params` parameters, a multiple of eight. Without memberships nothing is planned.
    pub(in super::super) fn new(
        image_camera: &[u32],
        chunks: &[Chunk],
        memberships: Memberships,
        cameras: &[u32],
        params: usize,
    ) -> Self {
        let clusters = memberships.iter().flatten().map(|m| m.0 as usize + 1).max().unwrap_or(0);
        let mut plan = Self {
            memberships,
            image_camera: image_camera.to_vec(),
            eighths: params / BLOCK,
            clusters,
            cameras: if clusters > 0 { cameras.to_vec() } else { Vec::new() },
            row_start: vec![0],
            blocks: Vec::new(),
            pieces: Vec::new(),
            limits: Limits::default(),
        };
        if clusters > 0 {
            let entries = plan.find_blocks(chunks);
            plan.cut(chunks, (entries / PIECES).clamp(PIECE_ENTRIES.start, PIECE_ENTRIES.end));
        }
        plan
    }

    pub(super) fn num_images(&self) -> usize {
        self.memberships.len()
    }

    /// Rows of blocks.
    pub(in super::super) fn rows(&self) -> usize {
        self.clusters + self.cameras.len() * self.eighths
    }

    /// The camera and which eight of its parameters a row stands for; `None` for a cluster.
    pub(in super::super) fn camera_of_row(&self, row: usize) -> Option<(u32, u32)> {
        row.checked_sub(self.clusters).map(|k| (self.cameras[k / self.eighths], (k % self.eighths) as u32))
    }

    /// Rows that a point touches, ascending.
    pub(super) fn rows_of(&self, chunk: &Chunk, point: usize, rows: &mut Vec<u32>) {
        rows.clear();
        let eighths = self.eighths as u32;
        for &image in &chunk.by_point[chunk.tracks[point] as usize..chunk.tracks[point + 1] as usize] {
            let image = image as usize;
            rows.extend(self.memberships[image].iter().map(|m| m.0));
            let camera = self.image_camera[image];
            if let Some(k) = self.cameras.iter().position(|&c| c == camera) {
                let first = self.clusters as u32 + k as u32 * eighths;
                rows.extend(first..first + eighths);
            }
        }
        rows.sort_unstable();
        rows.dedup();
    }

    /// Keeps every pair of rows that meet at a point, and all diagonals. Returns how many entries the points have.
    fn find_blocks(&mut self, chunks: &[Chunk]) -> usize {
        let count = self.rows();
        let mut met = vec![false; count * count];
        (0..count).for_each(|row| met[row * count + row] = true);
        let (mut rows, mut entries) = (Vec::new(), 0);
        for chunk in chunks {
            for point in 0..chunk.points.len() {
                self.rows_of(chunk, point, &mut rows);
                entries += rows.len();
                for (k, &a) in rows.iter().enumerate() {
                    rows[k..].iter().for_each(|&b| met[a as usize * count + b as usize] = true);
                }
            }
        }
        for row in 0..count {
            let columns = (row..count).filter(|column| met[row * count + column]);
            self.blocks.extend(columns.map(|column| (row as u32, column as u32)));
            self.row_start.push(self.blocks.len() as u32);
        }
        entries
    }

    /// Cuts the points into pieces of at most so many entries; a point with more is a piece of its own.
    fn cut(&mut self, chunks: &[Chunk], entries: usize) {
        let mut rows = Vec::new();
        for (c, chunk) in chunks.iter().enumerate() {
            let (mut first, mut count) = (0, 0);
            for point in 0..chunk.points.len() {
                self.rows_of(chunk, point, &mut rows);
                if count > 0 && count + rows.len() > entries {
                    self.pieces.push(Piece { chunk: c, points: first..point });
                    (first, count) = (point, 0);
                }
                count += rows.len();
            }
            if count > 0 {
                self.pieces.push(Piece { chunk: c, points: first..chunk.points.len() });
            }
        }
        for piece in &self.pieces {
            let words = PieceWords::new(self, &chunks[piece.chunk], piece);
            self.limits = self.limits.max(words.limits());
        }
    }

    /// `Mode` of every image's memberships, as far as it is known before a state is.
    pub(in super::super) fn modes(&self) -> Vec<[u32; 8]> {
        let mode = |m: Option<&(u32, f64)>| {
            let (cluster, weight) = m.map_or((NO_CLUSTER, 0.0), |m| (m.0, m.1 as f32));
            [0, 0, 0, 0, cluster, weight.to_bits(), 0, 0]
        };
        let of_image = |row: &Vec<(u32, f64)>| (0..MAX_MEMBERSHIPS).map(|k| mode(row.get(k))).collect::<Vec<_>>();
        self.memberships.iter().flat_map(of_image).collect()
    }

    /// The clusters' part of the topology: their number, offsets, members.
    pub(in super::super) fn cluster_lists(&self) -> Vec<u32> {
        let mut members = vec![Vec::new(); self.clusters];
        for (image, row) in self.memberships.iter().enumerate() {
            for (k, &(cluster, _)) in row.iter().enumerate() {
                members[cluster as usize].push((MAX_MEMBERSHIPS * image + k) as u32);
            }
        }
        let mut lists = vec![self.clusters as u32, 0];
        let mut end = 0;
        lists.extend(members.iter().map(|m| {
            end += m.len() as u32;
            end
        }));
        lists.extend(members.into_iter().flatten());
        lists
    }

    /// `CoarseBlock` of every block.
    pub(super) fn block_words(&self) -> Vec<[u32; 8]> {
        const NONE: u32 = u32::MAX;
        let words = |&(row, column): &(u32, u32)| {
            let (camera, eighth) = self.camera_of_row(column as usize).unwrap_or((NONE, 0));
            let (row_camera, row_eighth) = self.camera_of_row(row as usize).unwrap_or((NONE, 0));
            [row, column, self.row_start[row as usize], camera, eighth, row_camera, row_eighth, 0]
        };
        self.blocks.iter().map(words).collect()
    }
}
