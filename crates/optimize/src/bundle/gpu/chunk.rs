//! Runs of points with their observations, small enough that every array of one fits a binding (`solver.md` §2.6).

use std::ops::Range;

use super::lattice::Lattice;
use super::records::Point;
use crate::bundle::problem::Problem;
use crate::gpu::sums::segments;
use crate::grouping::group;

/// The largest record of a chunk's arrays over points: a point's block.
pub(super) const POINT_BYTES: u64 = 96;

/// How large a chunk may grow. A track longer than that is a chunk of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkLimits {
    pub(super) points: usize,
    /// As many as are wanted, and as many as are possible.
    pub(super) observations: usize,
    pub(super) most_observations: usize,
    /// Of all chunks together: their sums lie in one buffer.
    pub(super) segments: usize,
}

/// What is uploaded of a chunk. Indices of points and observations count from its start.
#[derive(Debug)]
pub(super) struct Chunk {
    /// Its first point in the problem.
    pub(super) first_point: usize,
    pub(super) points: Vec<Point>,
    /// `points + 1` offsets into the points' order.
    pub(super) tracks: Vec<u32>,
    /// Points' order: image.
    pub(super) by_point: Vec<u32>,
    /// Measured inverse depth and its weight; empty where no depth is known at all.
    pub(super) depths: Vec<[f32; 2]>,
    pub(super) pixels: Vec<[f32; 2]>,
    /// Images' order: point, weight, place in the points' order.
    pub(super) by_image: Vec<[u32; 4]>,
    /// For each place in the points' order, that in the images' order.
    pub(super) image_order: Vec<u32>,
    /// Image, start, end, slot of the sums.
    pub(super) segments: Vec<[u32; 4]>,
}

/// Observations of a point that take part: tracks that cannot fix a point are left out where points may move.
fn kept(problem: &Problem, point: usize) -> Range<usize> {
    let (start, end) = (problem.track_start[point] as usize, problem.track_start[point + 1] as usize);
    if problem.fixed_points || end - start >= 2 { start..end } else { start..start }
}

/// All chunks. More chunks cut images into more segments; where those become too many, chunks grow as far as they can.
pub(super) fn chunks(problem: &Problem, mut limits: ChunkLimits, lattice: &Lattice) -> Vec<Chunk> {
    loop {
        let runs = split(problem, limits).into_iter();
        let chunks: Vec<_> = runs.map(|run| Chunk::new(problem, run, lattice)).collect();
        let segments: usize = chunks.iter().map(|c| c.segments.len()).sum();
        if segments <= limits.segments || limits.observations >= limits.most_observations {
            return chunks;
        }
        limits.observations = limits.observations.saturating_mul(2).clamp(1, limits.most_observations);
    }
}

/// Runs of points, as long as the limits allow.
fn split(problem: &Problem, limits: ChunkLimits) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let (mut first, mut observations) = (0, 0);
    for point in 0..problem.points.len() {
        let more = kept(problem, point).len();
        if point > first && (observations + more > limits.observations || point - first >= limits.points) {
            runs.push(first..point);
            (first, observations) = (point, 0);
        }
        observations += more;
    }
    if first < problem.points.len() {
        runs.push(first..problem.points.len());
    }
    runs
}

impl Chunk {
    fn new(problem: &Problem, run: Range<usize>, lattice: &Lattice) -> Self {
        let mut chunk = Self {
            first_point: run.start,
            points: problem.points[run.clone()].iter().map(|&p| point(lattice, p)).collect(),
            tracks: Vec::with_capacity(run.len() + 1),
            by_point: Vec::new(),
            depths: Vec::new(),
            pixels: Vec::new(),
            by_image: Vec::new(),
            image_order: Vec::new(),
            segments: Vec::new(),
        };
        let point_of = chunk.sort_tracks(problem, run);
        chunk.sort_images(problem.cam_from_world.len(), &point_of);
        chunk
    }

    /// Observations by point and image.
    fn sort_tracks(&mut self, problem: &Problem, run: Range<usize>) -> Vec<u32> {
        let mut point_of = Vec::new();
        let mut order: Vec<usize> = Vec::new();
        let depth = problem.depth.as_ref().filter(|depth| depth.is_any());
        self.tracks.push(0);
        for (p, point) in (0u32..).zip(run) {
            order.clear();
            order.extend(kept(problem, point));
            order.sort_by_key(|&o| problem.observation_image[o]);
            for &o in &order {
                self.by_point.push(problem.observation_image[o]);
                self.depths.extend(depth.map(|depth| [depth.inverse[o] as f32, depth.weight[o] as f32]));
                self.pixels.push(problem.observation_px[o].to_array().map(|v| v as f32));
                point_of.push(p);
            }
            self.tracks.push(self.by_point.len() as u32);
        }
        point_of
    }

    /// The images' order, cut into segments whose slots are given later.
    fn sort_images(&mut self, images: usize, point_of: &[u32]) {
        let (start, order) = group(&self.by_point, images);
        self.by_image = order.iter().map(|&o| [point_of[o as usize], 0, o, 0]).collect();
        self.image_order = vec![0; order.len()];
        for (place, &o) in (0u32..).zip(&order) {
            self.image_order[o as usize] = place;
        }
        self.segments = segments(&start);
    }
}

/// Gives every segment the slot of its sums: the slots of an image follow one another, chunk by chunk, so that whoever
/// sums them goes through all chunks in a fixed order. Returns `images + 1` offsets.
pub(super) fn assign_slots(chunks: &mut [Chunk], images: usize) -> Vec<u32> {
    let image_of: Vec<u32> = chunks.iter().flat_map(|c| &c.segments).map(|s| s[0]).collect();
    let (start, order) = group(&image_of, images);
    let mut all: Vec<_> = chunks.iter_mut().flat_map(|c| &mut c.segments).collect();
    for (slot, &segment) in (0u32..).zip(&order) {
        all[segment as usize][3] = slot;
    }
    start
}

fn point(lattice: &Lattice, position: glam::DVec3) -> Point {
    let (cell, offset) = lattice.point(position);
    let [x, y, z] = offset.map(f32::to_bits);
    [x, y, z, cell, 0, 0, 0, 0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(points: usize, observations: usize) -> ChunkLimits {
        ChunkLimits { points, observations, most_observations: 1 << 20, segments: 1 << 20 }
    }

    #[test]
    fn runs_cover_all_points_within_the_limits_and_long_tracks_stand_alone() {
        let lengths = [3, 4, 1, 50, 2, 2, 0, 0, 0, 0, 5];
        let mut problem = Problem { track_start: vec![0], ..Problem::default() };
        for length in lengths {
            problem.points.push(glam::DVec3::ZERO);
            problem.track_start.push(problem.track_start[problem.points.len() - 1] + length);
        }
        assert_eq!(split(&problem, limits(4, 7)), [0..3, 3..4, 4..8, 8..11]);
        assert_eq!(split(&problem, limits(100, 1000)).len(), 1);
        assert!(split(&Problem { track_start: vec![0], ..Problem::default() }, limits(1, 1)).is_empty());
    }

    #[test]
    fn chunks_grow_where_their_segments_would_be_too_many() {
        let mut problem = Problem { track_start: vec![0], ..Problem::default() };
        problem.cam_from_world = vec![epipole_geometry::Rigid3::IDENTITY; 10];
        for _ in 0..1000 {
            problem.points.push(glam::DVec3::Z);
            problem.observation_image.extend(0..10);
            problem.observation_px.extend([glam::DVec2::ZERO; 10]);
            problem.track_start.push(problem.observation_image.len() as u32);
        }
        let lattice = Lattice::new(&problem);
        let shape = |limits| {
            let found = chunks(&problem, limits, &lattice);
            assert_eq!(found.iter().map(|c| c.by_point.len()).sum::<usize>(), 10_000);
            (found.len(), found.iter().map(|c| c.segments.len()).sum::<usize>())
        };
        assert_eq!(shape(limits(1000, 100)), (100, 1000));
        assert_eq!(shape(ChunkLimits { segments: 200, ..limits(1000, 100) }), (13, 130));
        // As far as they can: the buffer's own limit then says what is wrong.
        assert_eq!(shape(ChunkLimits { segments: 20, most_observations: 500, ..limits(1000, 100) }), (20, 200));
    }
}
