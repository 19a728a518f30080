//! How long the records are that depend on a variant: as `shaders/common/unit.wgsl`, `shaders/bundle/block_sums.wgsl` and
//! `shaders/bundle/observation.wgsl` count.

use epipole_geometry::camera::{CameraModel, MAX_PARAMS};

use super::records::{Intrinsics, MAX_DEPTH_SIGMAS};
use crate::bundle::depth::Depth;
use crate::bundle::problem::Problem;
use crate::gpu::Variant;
use crate::loss::Loss;

/// Parameters of a camera in the narrow variant, those of OPENCV.
const NARROW_PARAMS: usize = 8;
/// Words of a camera's record behind its parameters.
const KIND_WORDS: usize = 4;
/// Unknowns of a pose.
const POSE: usize = 6;

/// The variant a problem's cameras and depths ask for.
pub(super) fn variant(problem: &Problem) -> Variant {
    let is_narrow = |model| {
        use CameraModel::{OpenCv, Pinhole, Radial, SimplePinhole, SimpleRadial};
        matches!(model, SimplePinhole | Pinhole | SimpleRadial | Radial | OpenCv)
    };
    let cameras = if problem.cameras.iter().all(|c| is_narrow(c.model)) { Variant::default() } else { Variant::WIDE };
    let has_depth = problem.depth.as_ref().is_some_and(Depth::is_any);
    if has_depth { cameras.with(Variant::DEPTH) } else { cameras }
}

/// Record lengths in one variant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sizes {
    /// Parameters of a camera, and numbers of a unit in every vector.
    pub(super) params: usize,
    /// Whether observations have a third row.
    pub(super) depth: bool,
}

impl Sizes {
    pub(super) fn of(variant: Variant) -> Self {
        let params = if variant.has(Variant::WIDE) { MAX_PARAMS } else { NARROW_PARAMS };
        Self { params, depth: variant.has(Variant::DEPTH) }
    }

    /// Numbers of a `CameraStep`: two vec4f of a pose, then a camera's unit.
    pub(super) fn step(self) -> usize {
        8 + self.params
    }

    /// Unknowns of an image with its camera.
    pub(super) fn side(self) -> usize {
        POSE + self.params
    }

    /// Entries of the upper triangle of a block of that side.
    pub(super) fn triangle(self) -> usize {
        self.side() * (self.side() + 1) / 2
    }

    /// Sums of a segment in the preconditioner: triangle, right-hand side, triangle of the pose alone.
    pub(super) fn block_sums(self) -> usize {
        self.triangle() + self.side() + POSE * (POSE + 1) / 2
    }

    /// Sums of a span of points for an exact block.
    pub(super) fn group_sums(self) -> usize {
        self.params * self.params
    }

    /// Words of a camera's record.
    pub(super) fn intrinsics(self) -> usize {
        self.params + KIND_WORDS
    }

    /// Cameras' records as the variant lays them out.
    pub(super) fn pack(self, cameras: &[Intrinsics]) -> Vec<u32> {
        cameras.iter().flat_map(|c| c[..self.params].iter().chain(&c[MAX_PARAMS..])).copied().collect()
    }

    /// And back.
    pub(super) fn unpack(self, words: &[u32]) -> Vec<Intrinsics> {
        let one = |record: &[u32]| {
            let mut out = Intrinsics::default();
            let (params, kind) = record.split_at(self.params);
            out[..self.params].copy_from_slice(params);
            out[MAX_PARAMS..].copy_from_slice(kind);
            out
        };
        words.chunks_exact(self.intrinsics()).map(one).collect()
    }

    /// Words of `ByPoint`: image, weight, and that of the depth.
    pub(super) fn by_point(self) -> usize {
        if self.depth { 3 } else { 2 }
    }

    /// Observations in the points' order, without weights yet.
    pub(super) fn pack_by_point(self, images: &[u32]) -> Vec<u32> {
        let mut words = vec![0; self.by_point() * images.len()];
        words.iter_mut().step_by(self.by_point()).zip(images).for_each(|(word, &image)| *word = image);
        words
    }

    /// Words of `Residual`: pixels of two states; inverse depths of both, what was measured, its weight.
    pub(super) fn residual(self) -> usize {
        if self.depth { 8 } else { 4 }
    }

    /// Residuals before anything is known. What never has a valid projection costs the bound of its depth, as on the CPU.
    pub(super) fn pack_depths(self, depths: &[[f32; 2]], loss: Loss) -> Vec<f32> {
        let worst = if loss.bound().is_some() { MAX_DEPTH_SIGMAS } else { 0.0 };
        let record = |&[inverse, weight]: &[f32; 2]| {
            let unknown = if weight > 0.0 { (worst / weight).min(f32::MAX) } else { 0.0 };
            [0.0, 0.0, 0.0, 0.0, unknown, unknown, inverse, weight]
        };
        depths.iter().flat_map(record).collect()
    }

    /// The first numbers of each unit, as many as the variant keeps.
    pub(super) fn pack_units(self, units: &[[f32; MAX_PARAMS]]) -> Vec<f32> {
        units.iter().flat_map(|unit| &unit[..self.params]).copied().collect()
    }
}
