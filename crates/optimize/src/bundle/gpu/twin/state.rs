//! A copy of the device's buffers as numbers.

use std::ops::Range;

use epipole_geometry::camera::{CameraModel, MAX_PARAMS};
use pollster::block_on;

use super::coarse::Mode;
use super::num::{Num, Vec3};
use super::observation::{Errors, Weights};
use crate::bundle::gpu::GpuSystem;
use crate::bundle::gpu::buffers::ROW_ALIGN;
use crate::bundle::gpu::records::{EXACT_WORD, HIDDEN, OUT, param_slot};
use crate::bundle::gpu::sizes::Sizes;
use crate::reduced::coarse::MAX_MEMBERSHIPS;

#[derive(Clone)]
pub(super) struct View<N> {
    pub(super) rotation: [Vec3<N>; 3],
    pub(super) center: Vec3<N>,
    pub(super) cell: [i32; 3],
    pub(super) camera: usize,
}

#[derive(Clone)]
pub(super) struct Point<N> {
    pub(super) offset: Vec3<N>,
    pub(super) cell: [i32; 3],
    pub(super) s: Vec3<N>,
}

/// What is known of an observation's depth; weight 0 where nothing is.
#[derive(Clone, Copy)]
pub(super) struct Measured<N> {
    pub(super) inverse: N,
    pub(super) weight: N,
}

/// As `Block` in `block.wgsl`: six rows of four.
pub(super) type Block<N> = [[N; 4]; 6];

/// As `CameraStep` in `row.wgsl`: rotation, centre, two unused, parameters.
pub(super) type Step<N> = [N; 8 + MAX_PARAMS];
/// As in `vectors.wgsl`.
const SECTIONS: usize = 10;

fn padded<N: Num, const W: usize>(numbers: impl IntoIterator<Item = N>) -> [N; W] {
    let mut out = [N::of(0.0); W];
    out.iter_mut().zip(numbers).for_each(|(out, number)| *out = number);
    out
}

/// Everything that kernels read.
pub(super) struct State<N> {
    pub(super) cell: N,
    pub(super) lambda: N,
    pub(super) loss: (u32, N),
    pub(super) depth_loss: (u32, N),
    /// As in the parameters.
    pub(super) activation: u32,
    pub(super) tau: N,
    pub(super) refresh_flags: u32,
    pub(super) revive_all: bool,
    /// By image: least depth; left, top, right, bottom, px.
    pub(super) limits: Vec<[N; 5]>,
    pub(super) images: usize,
    pub(super) cameras: usize,
    pub(super) tracks: Vec<u32>,
    /// Points of each workgroup, in the order of their rows of sums; none where chunks leave rows out.
    pub(super) rows: Vec<Range<usize>>,
    /// In the order of their slots.
    pub(super) segments: Vec<[u32; 4]>,
    pub(super) topology: Vec<u32>,
    pub(super) sizes: Sizes,
    pub(super) freedom: Vec<[N; MAX_PARAMS]>,
    /// Means of a camera's parameters, then their inverse variances.
    pub(super) priors: Vec<[N; 2 * MAX_PARAMS]>,
    pub(super) pixels: Vec<[N; 2]>,
    pub(super) views: Vec<View<N>>,
    /// fx, fy, cx, cy, then the distortion; 0 beyond what the variant keeps, here and in all that follows.
    pub(super) intrinsics: Vec<[N; MAX_PARAMS]>,
    pub(super) single_focal: Vec<bool>,
    /// Cameras with an exact block in the preconditioner.
    pub(super) exact: Vec<bool>,
    pub(super) models: Vec<CameraModel>,
    /// Of the preconditioner's second level: by membership, then whether there is an inverse, and its rows.
    pub(super) modes: Vec<Mode<N>>,
    pub(super) has_coarse_space: bool,
    pub(super) coarse_inverse: Vec<N>,
    pub(super) clusters: usize,
    pub(super) points: Vec<Point<N>>,
    pub(super) changes: Vec<[N; 4]>,
    /// Image (with OUT) and weights.
    pub(super) by_point: Vec<(u32, Weights<N>)>,
    /// Point, weights, place in the points' order.
    pub(super) by_image: Vec<(usize, Weights<N>, usize)>,
    /// At the accepted and at the tried state.
    pub(super) residuals: Vec<[Errors<N>; 2]>,
    pub(super) measured: Vec<Measured<N>>,
    pub(super) blocks: Vec<Block<N>>,
    pub(super) partials: Vec<Step<N>>,
    pub(super) product_sums: Vec<[N; 8]>,
    pub(super) inverses: Vec<Vec<N>>,
    /// Four rows of state, then sections of a few rows a unit.
    pub(super) vectors: Vec<[N; 4]>,
}

impl<N: Num> State<N> {
    /// All chunks as one.
    pub(super) fn download(system: &GpuSystem<'_>) -> Self {
        let (layout, resident) = (&system.layout, &system.resident);
        let (buffers, params) = (&resident.buffers, &resident.params);
        let (images, cameras) = (layout.views.len(), layout.intrinsics.len());
        let words = |buffer, count| block_on(system.device().download::<u32>(buffer, count)).expect("a live device");
        let real = |w: u32| N::of(f32::from_bits(w));
        let rows4 = |words: Vec<u32>| -> Vec<[N; 4]> {
            words.chunks_exact(4).map(|w| std::array::from_fn(|k| real(w[k]))).collect()
        };
        let views = words(&buffers.views, 64 * images);
        let (views, limits) = views.split_at(48 * images);
        let sizes = layout.sizes;
        let intrinsics = sizes.unpack(&words(&buffers.intrinsics, 3 * sizes.intrinsics() * cameras));
        let mut state = Self {
            cell: N::of(params.cell),
            lambda: N::of(params.lambda),
            loss: (params.loss.0, N::of(params.loss.1)),
            depth_loss: (params.depth_loss.0, N::of(params.depth_loss.1)),
            activation: params.activation,
            tau: N::of(params.tau),
            refresh_flags: params.refresh_flags,
            revive_all: params.revive_all,
            limits: limits.chunks_exact(16).map(|w| std::array::from_fn(|k| real(w[k]))).collect(),
            images,
            cameras,
            tracks: vec![0],
            rows: Vec::new(),
            segments: vec![[0; 4]; layout.segments],
            topology: layout.topology.clone(),
            sizes,
            freedom: layout.freedom.iter().map(|f| f.map(N::of)).collect(),
            priors: layout.priors.rows.iter().map(|p| padded(p.as_flattened().iter().map(|&p| N::of(p)))).collect(),
            pixels: Vec::new(),
            views: views
                .chunks_exact(16)
                .map(|w| View {
                    rotation: std::array::from_fn(|k| std::array::from_fn(|j| real(w[4 * k + j]))),
                    center: std::array::from_fn(|k| real(w[4 * k + 3])),
                    cell: std::array::from_fn(|k| w[12 + k] as i32),
                    camera: w[15] as usize,
                })
                .collect(),
            single_focal: intrinsics.iter().map(|w| w[MAX_PARAMS] == 1).collect(),
            exact: intrinsics.iter().map(|w| w[EXACT_WORD] == 1).collect(),
            models: intrinsics.iter().map(|w| CameraModel::ALL[w[MAX_PARAMS + 1] as usize]).collect(),
            intrinsics: intrinsics.iter().map(|w| std::array::from_fn(|k| real(w[k]))).collect(),
            modes: words(&buffers.coarse.modes, 8 * MAX_MEMBERSHIPS * images).chunks_exact(8).map(Mode::read).collect(),
            has_coarse_space: f32::from_bits(words(&buffers.coarse.inverse, 1)[0]) != 0.0,
            coarse_inverse: words(&buffers.coarse.inverse, 4 + 64 * layout.plan.rows().pow(2))[4..]
                .iter()
                .map(|&w| real(w))
                .collect(),
            clusters: layout.plan.clusters,
            points: Vec::new(),
            changes: Vec::new(),
            by_point: Vec::new(),
            by_image: Vec::new(),
            residuals: Vec::new(),
            measured: Vec::new(),
            blocks: Vec::new(),
            partials: words(&buffers.partials, sizes.step() * layout.segments)
                .chunks_exact(sizes.step())
                .map(|w| padded(w.iter().map(|&w| real(w))))
                .collect(),
            product_sums: words(&buffers.product_sums, 8 * resident.params.point_groups as usize)
                .chunks_exact(8)
                .map(|w| std::array::from_fn(|k| real(w[k])))
                .collect(),
            inverses: words(&buffers.inverses, sizes.side() * sizes.side() * (images + cameras))
                .chunks_exact(sizes.side() * sizes.side())
                .map(|w| w.iter().map(|&w| real(w)).collect())
                .collect(),
            vectors: rows4(words(&buffers.vectors, 16 + SECTIONS * sizes.params * (images + cameras))),
        };
        for (chunk, buffers) in layout.chunks.iter().zip(&resident.chunks) {
            let (first, observation) = (state.points.len(), state.by_point.len());
            let (points, observations) = (chunk.points.len(), chunk.by_point.len());
            state.rows.resize(state.rows.len().next_multiple_of(ROW_ALIGN as usize), 0..0);
            state.rows.extend((0..points).step_by(64).map(|p| first + p..first + points.min(p + 64)));
            state.tracks.extend(chunk.tracks[1..].iter().map(|&o| o + observation as u32));
            for &[image, start, end, slot] in &chunk.segments {
                let base = observation as u32;
                state.segments[slot as usize] = [image, start + base, end + base, slot];
            }
            state.pixels.extend(chunk.pixels.iter().map(|p| p.map(N::of)));
            state.points.extend(words(&buffers.points, 8 * points).chunks_exact(8).map(|w| Point {
                offset: std::array::from_fn(|k| real(w[k])),
                cell: std::array::from_fn(|k| (w[3] >> (10 * k) & 1023) as i32),
                s: std::array::from_fn(|k| real(w[4 + k])),
            }));
            state.changes.extend(rows4(words(&buffers.changes, 4 * points)));
            // What a problem without depth has none of is zero.
            let at = |w: &[u32], k: usize| if k < w.len() { real(w[k]) } else { N::of(0.0) };
            let by_point = words(&buffers.by_point, sizes.by_point() * observations);
            let records = by_point.chunks_exact(sizes.by_point());
            state.by_point.extend(records.map(|w| (w[0], [real(w[1]), at(w, 2)])));
            let by_image = words(&buffers.by_image, 4 * observations);
            let records = by_image.chunks_exact(4);
            state.by_image.extend(
                records.map(|w| (first + w[0] as usize, [real(w[1]), real(w[3])], observation + w[2] as usize)),
            );
            for w in words(&buffers.residuals, sizes.residual() * observations).chunks_exact(sizes.residual()) {
                state.residuals.push([0, 2].map(|k| [real(w[k]), real(w[k + 1]), at(w, 4 + k / 2)]));
                state.measured.push(Measured { inverse: at(w, 6), weight: at(w, 7) });
            }
            let blocks = rows4(words(&buffers.blocks, 24 * points));
            state.blocks.extend(blocks.chunks_exact(6).map(|b| std::array::from_fn(|k| b[k])));
        }
        for slot in 0..state.segments.len() {
            let camera = state.views[state.segments[slot][0] as usize].camera;
            let missing = (0..MAX_PARAMS).filter(|&k| !state.has_param(camera, k)).collect::<Vec<_>>();
            missing.into_iter().for_each(|k| state.partials[slot][8 + k] = N::of(0.0));
        }
        state
    }

    /// Whether a record's parameter is one of the model's. The wide kernels differentiate a family by what any of its
    /// models has, and the column scale removes what is too much; the twin's derivatives know the model.
    pub(super) fn has_param(&self, camera: usize, slot: usize) -> bool {
        let model = self.models[camera];
        !self.is_wide() || (0..model.num_params()).any(|k| param_slot(model, k) == slot)
    }

    /// A unit's numbers in a section of the vectors.
    pub(super) fn unit(&self, section: usize, unit: usize) -> [N; MAX_PARAMS] {
        let rows = self.sizes.params / 4;
        let at = 4 + section * rows * (self.images + self.cameras) + rows * unit;
        padded(self.vectors[at..at + rows].iter().flatten().copied())
    }

    pub(super) fn members(&self, camera: usize) -> &[u32] {
        let at = self.images + 1 + camera;
        let first = self.images + self.cameras + 2;
        &self.topology[first + self.topology[at] as usize..first + self.topology[at + 1] as usize]
    }

    pub(super) fn segments_of(&self, image: usize) -> std::ops::Range<usize> {
        self.topology[image] as usize..self.topology[image + 1] as usize
    }

    /// Of an observation in the points' order.
    pub(super) fn image(&self, observation: usize) -> usize {
        (self.by_point[observation].0 & !(OUT | HIDDEN)) as usize
    }

    pub(super) fn track(&self, point: usize) -> std::ops::Range<usize> {
        self.tracks[point] as usize..self.tracks[point + 1] as usize
    }
}
