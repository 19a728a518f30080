//! The observations as the kernels' arrays: chunks of points, each with both orders, segments and samples.

use std::ops::Range;

use crate::gpu::sums::segments;
use crate::grouping::group;
use crate::positioning::layout::Layout;

/// Observations of a chunk: what its kernels gather then stays in the cache, and no binding comes near WebGPU's 128 MiB
/// (source: `solver.md` §2.6).
pub(super) const CHUNK_OBSERVATIONS: usize = 1 << 20;
/// Points of a chunk at most, for the same reason: a block has 64 bytes.
const CHUNK_POINTS: usize = 1 << 20;
/// Points that one workgroup handles.
pub(super) const POINT_GROUP: usize = 64;

/// Some points with all that belongs to them.
#[derive(Debug)]
pub(super) struct Chunk {
    pub(super) points: Range<usize>,
    pub(super) observations: Range<usize>,
    /// `points + 1` offsets into the points' order.
    pub(super) tracks: Vec<u32>,
    /// Points' order: camera, and room for the scale.
    pub(super) by_point: Vec<[u32; 2]>,
    /// Cameras' order: point, room for the scale, place in the points' order.
    pub(super) by_camera: Vec<[u32; 3]>,
    /// Camera, start, end.
    pub(super) segments: Vec<[u32; 4]>,
    /// Point, camera, place in the points' order, place among all samples.
    pub(super) samples: Vec<[u32; 4]>,
    pub(super) first_segment: usize,
    pub(super) first_group: usize,
}

impl Chunk {
    /// Workgroups of its points.
    pub(super) fn groups(&self) -> usize {
        self.points.len().div_ceil(POINT_GROUP)
    }
}

/// All chunks, and who belongs to whom across them.
#[derive(Debug)]
pub(super) struct Chunks {
    pub(super) chunks: Vec<Chunk>,
    /// See `shaders/positioning/factor.wgsl`.
    pub(super) topology: Vec<u32>,
    pub(super) segments: usize,
    pub(super) groups: usize,
    pub(super) samples: usize,
}

impl Chunks {
    /// Cuts where a chunk has the given number of observations. No track is cut.
    pub(super) fn new(layout: &Layout, observations: usize) -> Self {
        let mut out = Self { chunks: Vec::new(), topology: Vec::new(), segments: 0, groups: 0, samples: 0 };
        let mut camera_of_segment = Vec::new();
        let mut begin = 0;
        for end in 1..=layout.points() {
            let size = (layout.track_start[end] - layout.track_start[begin]) as usize;
            if size >= observations || end - begin >= CHUNK_POINTS || end == layout.points() {
                let chunk = out.cut(layout, begin..end);
                camera_of_segment.extend(chunk.segments.iter().map(|segment| segment[0]));
                out.segments += chunk.segments.len();
                out.groups += chunk.groups();
                out.samples += chunk.samples.len();
                out.chunks.push(chunk);
                begin = end;
            }
        }
        let (start, members) = group(&camera_of_segment, layout.cameras());
        out.topology = start;
        out.topology.extend(members);
        out
    }

    fn cut(&self, layout: &Layout, points: Range<usize>) -> Chunk {
        let first = layout.track_start[points.start];
        let tracks: Vec<u32> = layout.track_start[points.start..=points.end].iter().map(|&o| o - first).collect();
        let observations = first as usize..layout.track_start[points.end] as usize;
        let cameras = &layout.camera[observations.clone()];
        let local_point = |o: u32| layout.point[(first + o) as usize] - points.start as u32;
        let (start, order) = group(cameras, layout.cameras());
        let places = layout.sample().filter(|o| observations.contains(o)).map(|o| o as u32 - first);
        let samples = places.zip(self.samples as u32..);
        Chunk {
            samples: samples.map(|(o, slot)| [local_point(o), cameras[o as usize], o, slot]).collect(),
            tracks,
            by_point: cameras.iter().map(|&camera| [camera, 0]).collect(),
            by_camera: order.into_iter().map(|o| [local_point(o), 0, o]).collect(),
            segments: segments(&start),
            first_segment: self.segments,
            first_group: self.groups,
            points,
            observations,
        }
    }
}
