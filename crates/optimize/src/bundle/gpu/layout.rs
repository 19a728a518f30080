//! A problem as the kernels' arrays: observations in two orders, segments, who belongs to whom, and the start state.

use super::lattice::Lattice;
use super::records::{CAMERA_UNKNOWNS, Intrinsics, OUT, Point, View, intrinsics, param_slots};
use crate::bundle::problem::{PoseFreedom, Problem};
use crate::gpu::{GpuError, Variant};

/// Observations of one image that one workgroup sums (source: `solver.md` §2.1).
const SEGMENT: usize = 512;
/// As `FEW_IMAGES` in `topology.wgsl`.
pub(super) const FEW_IMAGES: usize = 32;

/// Everything that is uploaded.
#[derive(Debug)]
pub(super) struct Layout {
    /// In which variant the kernels run.
    pub(super) variant: Variant,
    pub(super) lattice: Lattice,
    /// `points + 1` offsets into the points' order.
    pub(super) tracks: Vec<u32>,
    /// Points' order: image and weight.
    pub(super) by_point: Vec<[u32; 2]>,
    pub(super) pixels: Vec<[f32; 2]>,
    /// Images' order: point, weight, place in the points' order.
    pub(super) by_image: Vec<[u32; 4]>,
    /// For each place in the points' order, that in the images' order.
    pub(super) image_order: Vec<u32>,
    /// Image, start, end.
    pub(super) segments: Vec<[u32; 4]>,
    /// See `shaders/bundle/topology.wgsl`.
    pub(super) topology: Vec<u32>,
    pub(super) big_cameras: usize,
    /// Two vec4 an image and a camera: 1 where an unknown may move.
    pub(super) freedom: Vec<[f32; 8]>,
    /// Accepted state; the kernels' buffers hold it three times.
    pub(super) views: Vec<View>,
    pub(super) intrinsics: Vec<Intrinsics>,
    pub(super) points: Vec<Point>,
}

impl Layout {
    pub(super) fn new(problem: &Problem) -> Result<Self, GpuError> {
        if problem.param_priors.iter().any(|priors| !priors.is_empty()) {
            return Err(GpuError::Unsupported { what: "a prior on camera parameters" });
        }
        let lattice = Lattice::new(problem);
        let mut layout = Self {
            variant: Variant::default(),
            tracks: Vec::new(),
            by_point: Vec::new(),
            pixels: Vec::new(),
            by_image: Vec::new(),
            image_order: Vec::new(),
            segments: Vec::new(),
            topology: Vec::new(),
            big_cameras: 0,
            freedom: freedom(problem)?,
            views: views(problem, &lattice),
            intrinsics: problem.cameras.iter().map(|c| intrinsics(c.model, &c.params)).collect::<Result<_, _>>()?,
            points: problem.points.iter().map(|&p| point(&lattice, p)).collect(),
            lattice,
        };
        let point_of = layout.sort_tracks(problem);
        layout.sort_images(problem.cam_from_world.len(), &point_of);
        layout.add_members(problem);
        Ok(layout)
    }

    /// Observations by point and image; tracks that cannot fix a point are left out where points may move.
    fn sort_tracks(&mut self, problem: &Problem) -> Vec<u32> {
        let mut point_of = Vec::new();
        let mut order: Vec<u32> = Vec::new();
        self.tracks.push(0);
        for (p, range) in (0u32..).zip(problem.track_start.windows(2)) {
            if problem.fixed_points || range[1] - range[0] >= 2 {
                order.clear();
                order.extend(range[0]..range[1]);
                order.sort_by_key(|&o| problem.observation_image[o as usize]);
                for &o in &order {
                    self.by_point.push([problem.observation_image[o as usize], 0]);
                    self.pixels.push(problem.observation_px[o as usize].to_array().map(|v| v as f32));
                    point_of.push(p);
                }
            }
            self.tracks.push(self.by_point.len() as u32);
        }
        point_of
    }

    /// The images' order, cut into segments; the first part of the topology.
    fn sort_images(&mut self, images: usize, point_of: &[u32]) {
        let mut start = vec![0u32; images + 1];
        self.by_point.iter().for_each(|o| start[o[0] as usize + 1] += 1);
        (0..images).for_each(|i| start[i + 1] += start[i]);
        let mut next = start.clone();
        self.by_image = vec![[0; 4]; self.by_point.len()];
        for (o, observation) in self.by_point.iter().enumerate() {
            let place = &mut next[observation[0] as usize];
            self.by_image[*place as usize] = [point_of[o], 0, o as u32, 0];
            self.image_order.push(*place);
            *place += 1;
        }
        for (i, range) in (0u32..).zip(start.windows(2)) {
            self.topology.push(self.segments.len() as u32);
            for from in (range[0]..range[1]).step_by(SEGMENT) {
                self.segments.push([i, from, range[1].min(from + SEGMENT as u32), 0]);
            }
        }
        self.topology.push(self.segments.len() as u32);
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
        let big = (0..cameras).filter(|&c| counts[c] > FEW_IMAGES).map(|c| c as u32);
        let before = self.topology.len();
        self.topology.extend(big);
        self.big_cameras = self.topology.len() - before;
    }
}

fn point(lattice: &Lattice, position: glam::DVec3) -> Point {
    let (cell, offset) = lattice.point(position);
    let [x, y, z] = offset.map(f32::to_bits);
    [x, y, z, cell, 0, 0, 0, 0]
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

fn freedom(problem: &Problem) -> Result<Vec<[f32; 8]>, GpuError> {
    let mut out = Vec::with_capacity(problem.cam_from_world.len() + problem.cameras.len());
    for freedom in &problem.pose_freedom {
        let (rotation, center) = match freedom {
            PoseFreedom::Free => (1.0, 1.0),
            PoseFreedom::RotationFixed => (0.0, 1.0),
            PoseFreedom::Fixed => (0.0, 0.0),
        };
        out.push([rotation, rotation, rotation, center, center, center, 0.0, 0.0]);
    }
    for (camera, refine) in problem.cameras.iter().zip(&problem.refine_params) {
        let mut row = [0.0; CAMERA_UNKNOWNS];
        for (&slot, &free) in param_slots(camera.model)?.iter().zip(refine) {
            row[slot] = if free { 1.0 } else { 0.0 };
        }
        out.push(row);
    }
    Ok(out)
}
