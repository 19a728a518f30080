//! A problem as the kernels' arrays: chunks of points, who belongs to whom, and the start state.

use std::sync::Arc;

use epipole_geometry::camera::MAX_PARAMS;

use super::chunk::{Chunk, ChunkLimits, assign_slots, chunks};
use super::coarse::{Plan, memberships};
use super::exact::{exact_cameras, spans};
use super::lattice::Lattice;
use super::priors::Priors;
use super::records::{EXACT_WORD, Intrinsics, OUT, View, intrinsics, param_slot};
use super::sizes::{Sizes, variant};
use crate::active::Activation;
use crate::bundle::frustum::Frusta;
use crate::bundle::options::Options;
use crate::bundle::problem::{PoseFreedom, Problem};
use crate::gpu::{GpuError, Variant};
use crate::loss::Loss;

/// As `FEW_IMAGES` in `topology.wgsl`.
pub(super) const FEW_IMAGES: usize = 32;

/// Everything that is uploaded.
#[derive(Debug)]
pub(super) struct Layout {
    /// In which variant the kernels run.
    pub(super) variant: Variant,
    pub(super) sizes: Sizes,
    /// Of inverse depths.
    pub(super) depth_loss: Loss,
    pub(super) lattice: Lattice,
    pub(super) chunks: Vec<Chunk>,
    /// Segments of all chunks.
    pub(super) segments: usize,
    /// See `shaders/bundle/topology.wgsl`.
    pub(super) topology: Vec<u32>,
    pub(super) big_cameras: usize,
    /// Cameras with an exact block in the preconditioner.
    pub(super) exact_cameras: usize,
    /// The preconditioner's second level.
    pub(super) plan: Arc<Plan>,
    /// By image, then by camera: 1 where an unknown may move.
    pub(super) freedom: Vec<[f32; MAX_PARAMS]>,
    pub(super) priors: Priors,
    /// Accepted state; the kernels' buffers hold it three times.
    pub(super) views: Vec<View>,
    /// What each image can see: the fourth block of the views.
    limits: Vec<View>,
    pub(super) intrinsics: Vec<Intrinsics>,
}

impl Layout {
    pub(super) fn new(problem: &Problem, options: &Options, limits: ChunkLimits) -> Result<Self, GpuError> {
        let variant = variant(problem);
        let lattice = Lattice::new(problem);
        let mut chunks = chunks(problem, limits, &lattice);
        let exact = exact_cameras(problem);
        let clusters = memberships(problem, options.preconditioner);
        let plan = Plan::new(&problem.image_camera, &chunks, clusters, &exact, Sizes::of(variant).params);
        let topology = assign_slots(&mut chunks, problem.cam_from_world.len());
        let mut layout = Self {
            variant,
            sizes: Sizes::of(variant),
            depth_loss: problem.depth.as_ref().map_or(Loss::Squared, |depth| depth.loss),
            segments: chunks.iter().map(|c| c.segments.len()).sum(),
            chunks,
            topology,
            big_cameras: 0,
            exact_cameras: exact.len(),
            plan: Arc::new(plan),
            freedom: freedom(problem),
            priors: Priors::new(problem),
            views: views(problem, &lattice),
            limits: image_limits(problem, options.activation),
            intrinsics: problem.cameras.iter().map(|c| intrinsics(c.model, &c.params)).collect(),
            lattice,
        };
        layout.add_members(problem);
        layout.add_preconditioner(&exact);
        Ok(layout)
    }

    /// The views as the kernels' buffer holds them.
    pub(super) fn views_with_limits(&self) -> Vec<View> {
        let mut views = self.views.repeat(3);
        views.extend_from_slice(&self.limits);
        views
    }

    /// The rest of the topology: images of each camera.
    fn add_members(&mut self, problem: &Problem) {
        let cameras = problem.cameras.len();
        let mut members: Vec<u32> = (0..problem.image_camera.len() as u32).collect();
        members.sort_by_key(|&i| problem.image_camera[i as usize]);
        let mut counts = vec![0usize; cameras];
        problem.image_camera.iter().for_each(|&c| counts[c as usize] += 1);
        let mut offset = 0;
        self.topology.push(0);
        for &count in &counts {
            offset += count as u32;
            self.topology.push(offset);
        }
        self.topology.extend(members);
        self.topology.extend(&problem.image_camera);
        let big = (0..cameras).filter(|&c| counts[c] > FEW_IMAGES).map(|c| c as u32);
        let before = self.topology.len();
        self.topology.extend(big);
        self.big_cameras = self.topology.len() - before;
    }

    /// The end of the topology: cameras with an exact block, which are marked as such, and clusters of images.
    fn add_preconditioner(&mut self, exact: &[u32]) {
        exact.iter().for_each(|&c| self.intrinsics[c as usize][EXACT_WORD] = 1);
        let slots: usize = self.chunks.iter().map(spans).sum();
        self.topology.extend([exact.len() as u32, slots as u32]);
        self.topology.extend(exact);
        self.topology.extend(self.plan.cluster_lists());
    }
}

/// See `shaders/bundle/sight.wgsl`.
fn image_limits(problem: &Problem, activation: Activation) -> Vec<View> {
    let frusta = Frusta::new(problem, activation);
    let limit = |i: usize| {
        let mut row = [0; 16];
        // Models without a half space that they cannot see have no least depth.
        let depth = frusta.least_depth(i).map_or(f64::from(f32::MIN), |depth| depth.max(1e-20));
        let values = [depth].into_iter().chain(frusta.bounds_px(i));
        row.iter_mut().zip(values).for_each(|(word, value)| *word = (value as f32).to_bits());
        row
    };
    (0..problem.cam_from_world.len()).map(limit).collect()
}

fn views(problem: &Problem, lattice: &Lattice) -> Vec<View> {
    let view = |(pose, &camera): (&epipole_geometry::Rigid3, &u32)| {
        let columns = glam::DMat3::from_quat(pose.rotation.normalize());
        let (cell, offset) = lattice.center(pose.center());
        let mut out = [0; 16];
        for k in 0..3 {
            let row = columns.row(k);
            let values = [row.x, row.y, row.z].map(|v| v as f32);
            for (word, value) in out[4 * k..].iter_mut().zip(values.into_iter().chain([offset[k]])) {
                *word = value.to_bits();
            }
            out[12 + k] = cell[k] as u32;
        }
        out[15] = camera & !OUT;
        out
    };
    problem.cam_from_world.iter().zip(&problem.image_camera).map(view).collect()
}

fn freedom(problem: &Problem) -> Vec<[f32; MAX_PARAMS]> {
    let mut out = Vec::with_capacity(problem.cam_from_world.len() + problem.cameras.len());
    for freedom in &problem.pose_freedom {
        let (rotation, center) = match freedom {
            PoseFreedom::Free => (1.0, 1.0),
            PoseFreedom::RotationFixed => (0.0, 1.0),
            PoseFreedom::Fixed => (0.0, 0.0),
        };
        let mut row = [0.0; MAX_PARAMS];
        row[..3].fill(rotation);
        row[3..6].fill(center);
        out.push(row);
    }
    for (camera, refine) in problem.cameras.iter().zip(&problem.refine_params) {
        let mut row = [0.0; MAX_PARAMS];
        for (param, &free) in refine.iter().enumerate().take(camera.model.num_params()) {
            row[param_slot(camera.model, param)] = if free { 1.0 } else { 0.0 };
        }
        out.push(row);
    }
    out
}
