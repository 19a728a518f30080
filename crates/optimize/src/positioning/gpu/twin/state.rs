//! A copy of the device's buffers as numbers.

use bytemuck::Pod;
use pollster::block_on;

use super::super::processor::Gpu;
use super::super::records::Settings;
use crate::bundle::gpu::twin::num::{Num, Vec3};

pub(super) struct Point<N> {
    pub(super) x: Vec3<N>,
    pub(super) cost: N,
    pub(super) s: Vec3<N>,
}

/// As `PointBlock` in `block.wgsl`: four rows of four.
pub(super) type Block<N> = [[N; 4]; 4];

pub(super) struct Chunk<N> {
    pub(super) first_segment: usize,
    pub(super) first_group: usize,
    pub(super) tracks: Vec<u32>,
    pub(super) points: Vec<Point<N>>,
    pub(super) blocks: Vec<Block<N>>,
    /// Camera and what is kept of the row.
    pub(super) by_point: Vec<(usize, N)>,
    /// Point, what is kept of the row, place in the points' order.
    pub(super) by_camera: Vec<(usize, N, usize)>,
    pub(super) rays: Vec<[N; 4]>,
    pub(super) segments: Vec<[u32; 4]>,
    pub(super) samples: Vec<[u32; 4]>,
}

/// Everything that kernels read.
pub(super) struct State<N> {
    pub(super) settings: Settings,
    pub(super) cameras: usize,
    pub(super) centers: Vec<[N; 4]>,
    pub(super) topology: Vec<u32>,
    /// Four rows of state, then sections of a row a camera.
    pub(super) vectors: Vec<[N; 4]>,
    pub(super) partials: Vec<[N; 4]>,
    pub(super) block_sums: Vec<[N; 12]>,
    pub(super) sums: Vec<[N; 8]>,
    pub(super) lengths: Vec<[N; 2]>,
    pub(super) chunks: Vec<Chunk<N>>,
}

fn download<T: Pod>(gpu: &Gpu<'_>, buffer: &wgpu::Buffer, count: usize) -> Vec<T> {
    block_on(gpu.device().download(buffer, count)).expect("a live device")
}

fn rows<N: Num, const W: usize>(gpu: &Gpu<'_>, buffer: &wgpu::Buffer, count: usize) -> Vec<[N; W]> {
    let reals: Vec<f32> = download(gpu, buffer, W * count);
    reals.chunks_exact(W).map(|row| std::array::from_fn(|k| N::of(row[k]))).collect()
}

impl<N: Num> State<N> {
    pub(super) fn download(gpu: &Gpu<'_>) -> Self {
        let (arrangement, shared) = (&gpu.arrangement, &gpu.resident.shared);
        let cameras = gpu.layout.cameras();
        let chunks = arrangement.chunks.iter().zip(&gpu.resident.chunks).map(|(chunk, buffers)| {
            let (points, observations) = (chunk.points.len(), chunk.observations.len());
            let by_point: Vec<[u32; 2]> = download(gpu, &buffers.by_point, observations);
            let by_camera: Vec<[u32; 3]> = download(gpu, &buffers.by_camera, observations);
            let kept = |bits| N::of(f32::from_bits(bits));
            let blocks: Vec<[N; 16]> = rows(gpu, &buffers.blocks, points);
            Chunk {
                first_segment: chunk.first_segment,
                first_group: chunk.first_group,
                tracks: chunk.tracks.clone(),
                points: rows::<N, 8>(gpu, &buffers.points, points)
                    .iter()
                    .map(|r| Point { x: [r[0], r[1], r[2]], cost: r[3], s: [r[4], r[5], r[6]] })
                    .collect(),
                blocks: blocks.iter().map(|b| std::array::from_fn(|k| std::array::from_fn(|j| b[4 * k + j]))).collect(),
                by_point: by_point.iter().map(|o| (o[0] as usize, kept(o[1]))).collect(),
                by_camera: by_camera.iter().map(|o| (o[0] as usize, kept(o[1]), o[2] as usize)).collect(),
                rays: rows(gpu, &buffers.rays, observations),
                segments: chunk.segments.clone(),
                samples: chunk.samples.clone(),
            }
        });
        Self {
            settings: gpu.settings,
            cameras,
            chunks: chunks.collect(),
            centers: rows(gpu, &shared.centers, 2 * cameras),
            topology: arrangement.topology.clone(),
            vectors: rows(gpu, &shared.vectors, 4 + 9 * cameras),
            partials: rows(gpu, &shared.partials, arrangement.segments),
            block_sums: rows(gpu, &shared.block_sums, arrangement.segments),
            sums: rows(gpu, &shared.sums, arrangement.groups),
            lengths: rows(gpu, &shared.lengths, arrangement.samples),
        }
    }

    pub(super) fn lambda(&self) -> N {
        N::of(self.settings.lambda)
    }

    /// A camera's numbers in a section of the vectors, as in `vectors.wgsl`.
    pub(super) fn vector(&self, section: usize, camera: usize) -> Vec3<N> {
        let row = self.vectors[4 + section * self.cameras + camera];
        [row[0], row[1], row[2]]
    }

    /// Accepted (block 0) or tried (1) centre.
    pub(super) fn center(&self, block: usize, camera: usize) -> Vec3<N> {
        let row = self.centers[block * self.cameras + camera];
        [row[0], row[1], row[2]]
    }

    pub(super) fn segments_of(&self, camera: usize) -> &[u32] {
        let list = &self.topology[self.cameras + 1..];
        &list[self.topology[camera] as usize..self.topology[camera + 1] as usize]
    }
}

impl<N: Num> Chunk<N> {
    pub(super) fn track(&self, point: usize) -> std::ops::Range<usize> {
        self.tracks[point] as usize..self.tracks[point + 1] as usize
    }
}
