//! Index structures of a bundle problem, built once: what refers to what, and which unknowns exist.

use std::sync::Arc;

use epipole_geometry::camera::CameraModel;

use crate::bundle::problem::{PoseFreedom, Problem};
use crate::grouping::group;
use crate::reduced::{BlockLayout, Incidence};

/// Where the refined parameters of a camera lie: `block`, starting at `offset` inside it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParamSlot {
    pub(super) block: usize,
    pub(super) offset: usize,
}

/// Everything about a problem that does not change during a solve.
#[derive(Debug)]
pub(super) struct Structure {
    /// Points × observations: observations of point `p` are `track_start[p]..track_start[p + 1]`, sorted by image.
    /// Tracks that cannot fix a point are empty.
    pub(super) track_start: Vec<u32>,
    pub(super) image: Vec<u32>,
    pub(super) point: Vec<u32>,
    pub(super) px: Vec<[f64; 2]>,
    /// Reference inverse depth and weight of each observation; empty where no depth is known at all.
    depth: Vec<[f64; 2]>,
    /// Observations of each image, ascending: `image_order[image_start[i]..image_start[i + 1]]`.
    pub(super) image_start: Vec<u32>,
    pub(super) image_order: Vec<u32>,
    pub(super) camera: Vec<u32>,
    /// Unknowns of each pose: 6 (rotation, centre), 3 (centre) or 0.
    pub(super) pose_dof: Vec<u8>,
    pub(super) model: Vec<CameraModel>,
    /// Refined parameters of each camera.
    pub(super) free_params: Vec<Vec<u8>>,
    pub(super) param_slot: Vec<ParamSlot>,
    /// Most refined parameters of any camera: row length of the stored parameter derivatives.
    pub(super) param_stride: usize,
    pub(super) fixed_points: bool,
    pub(super) layout: BlockLayout,
    pub(super) incidence: Arc<Incidence>,
}

impl Structure {
    pub(super) fn new(problem: &Problem) -> Self {
        let images = problem.cam_from_world.len();
        let Tracks { start: track_start, image, point, px, depth } = Tracks::sorted(problem);
        let (image_start, image_order) = group(&image, images);
        let pose_dof: Vec<u8> = problem
            .pose_freedom
            .iter()
            .map(|freedom| match freedom {
                PoseFreedom::Free => 6,
                PoseFreedom::RotationFixed => 3,
                PoseFreedom::Fixed => 0,
            })
            .collect();
        let free_params = free_params(problem);
        let (layout, param_slot) = lay_out(problem, &pose_dof, &free_params);
        let mut structure = Self {
            track_start,
            image,
            point,
            px,
            depth,
            image_start,
            image_order,
            camera: problem.image_camera.clone(),
            pose_dof,
            model: problem.cameras.iter().map(|c| c.model).collect(),
            param_stride: free_params.iter().map(Vec::len).max().unwrap_or(0),
            free_params,
            param_slot,
            fixed_points: problem.fixed_points,
            incidence: Arc::new(Incidence::empty(&layout)),
            layout,
        };
        structure.incidence = Arc::new(structure.incidence());
        structure
    }

    pub(super) fn num_points(&self) -> usize {
        self.track_start.len() - 1
    }

    pub(super) fn num_images(&self) -> usize {
        self.image_start.len() - 1
    }

    pub(super) fn track(&self, point: usize) -> std::ops::Range<usize> {
        self.track_start[point] as usize..self.track_start[point + 1] as usize
    }

    /// Reference inverse depth and weight of an observation, weight 0 where it has none.
    #[inline(always)]
    pub(super) fn depth(&self, observation: usize) -> [f64; 2] {
        self.depth.get(observation).copied().unwrap_or([0.0; 2])
    }

    pub(super) fn observations_of(&self, image: usize) -> &[u32] {
        &self.image_order[self.image_start[image] as usize..self.image_start[image + 1] as usize]
    }

    /// Whether the intrinsics of an image's camera are part of the image's own block.
    pub(super) fn owns_params(&self, image: usize) -> bool {
        self.param_slot[self.camera[image] as usize].block == image
    }

    /// Blocks per point: the images' (ascending, as tracks are sorted), then the shared cameras'. Where points are
    /// constant nothing is eliminated; then each image stands for a point, so that the pattern has its own blocks.
    fn incidence(&self) -> Incidence {
        let (mut start, mut blocks) = (vec![0u32], Vec::with_capacity(self.image.len()));
        let mut cameras = Vec::new();
        let mut meet = |images: &mut dyn Iterator<Item = usize>| {
            cameras.clear();
            let first = blocks.len();
            for i in images {
                if self.layout.size(i) > 0 && (blocks.len() == first || blocks[blocks.len() - 1] != i as u32) {
                    blocks.push(i as u32);
                }
                let slot = self.param_slot[self.camera[i] as usize];
                if slot.block != i && self.layout.size(slot.block) > 0 {
                    cameras.push(slot.block as u32);
                }
            }
            cameras.sort_unstable();
            cameras.dedup();
            blocks.extend_from_slice(&cameras);
            start.push(blocks.len() as u32);
        };
        if self.fixed_points {
            (0..self.num_images()).for_each(|i| meet(&mut std::iter::once(i)));
        } else {
            for p in 0..self.num_points() {
                meet(&mut self.image[self.track(p)].iter().map(|&i| i as usize));
            }
        }
        Incidence::new(&self.layout, start, blocks).expect("blocks are ascending: tracks are sorted by image")
    }
}

/// Observations by point and image; tracks with fewer than two observations are dropped where points may move.
struct Tracks {
    start: Vec<u32>,
    image: Vec<u32>,
    point: Vec<u32>,
    px: Vec<[f64; 2]>,
    depth: Vec<[f64; 2]>,
}

impl Tracks {
    fn sorted(problem: &Problem) -> Self {
        let count = problem.observation_image.len();
        let depth = problem.depth.as_ref().filter(|depth| depth.is_any());
        let mut tracks = Self {
            start: Vec::with_capacity(problem.points.len() + 1),
            image: Vec::with_capacity(count),
            point: Vec::with_capacity(count),
            px: Vec::with_capacity(count),
            depth: Vec::with_capacity(if depth.is_some() { count } else { 0 }),
        };
        tracks.start.push(0);
        let mut order: Vec<u32> = Vec::new();
        for (p, range) in problem.track_start.windows(2).enumerate() {
            if problem.fixed_points || range[1] - range[0] >= 2 {
                order.clear();
                order.extend(range[0]..range[1]);
                order.sort_by_key(|&o| problem.observation_image[o as usize]);
                for &o in &order {
                    tracks.image.push(problem.observation_image[o as usize]);
                    tracks.point.push(p as u32);
                    tracks.px.push(problem.observation_px[o as usize].to_array());
                    if let Some(depth) = depth {
                        tracks.depth.push([depth.inverse[o as usize], depth.weight[o as usize]]);
                    }
                }
            }
            tracks.start.push(tracks.image.len() as u32);
        }
        tracks
    }
}

/// Refined parameters of the cameras that any image uses.
fn free_params(problem: &Problem) -> Vec<Vec<u8>> {
    let mut used = vec![false; problem.cameras.len()];
    problem.image_camera.iter().for_each(|&c| used[c as usize] = true);
    let refined = |c: usize| {
        let count = if used[c] { problem.cameras[c].params.len() } else { 0 };
        (0..count as u8).filter(|&k| problem.refine_params[c][k as usize]).collect()
    };
    (0..problem.cameras.len()).map(refined).collect()
}

/// One block per image, then one per camera. A camera of a single image joins that image's block: fewer, fuller blocks.
fn lay_out(problem: &Problem, pose_dof: &[u8], free_params: &[Vec<u8>]) -> (BlockLayout, Vec<ParamSlot>) {
    let images = pose_dof.len();
    let mut users = vec![0usize; problem.cameras.len()];
    let mut last_user = vec![0usize; problem.cameras.len()];
    for (i, &c) in problem.image_camera.iter().enumerate() {
        users[c as usize] += 1;
        last_user[c as usize] = i;
    }
    let mut sizes: Vec<usize> = pose_dof.iter().map(|&dof| dof as usize).collect();
    sizes.resize(images + problem.cameras.len(), 0);
    let mut slots = Vec::with_capacity(problem.cameras.len());
    for c in 0..problem.cameras.len() {
        let slot = if users[c] == 1 {
            ParamSlot { block: last_user[c], offset: pose_dof[last_user[c]] as usize }
        } else {
            ParamSlot { block: images + c, offset: 0 }
        };
        sizes[slot.block] += free_params[c].len();
        slots.push(slot);
    }
    (BlockLayout::new(sizes), slots)
}
