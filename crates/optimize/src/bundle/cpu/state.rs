//! The state: poses, intrinsics and points, in `f64` for the few cameras and in the working scalar for what kernels see.
//!
//! In `f32` positions are an integer lattice cell and an offset inside it; differences of cells are exact, so that a
//! scene far from the origin loses nothing (source: `solver.md` §1.3 c). In `f64` there are no cells.

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{MAX_PARAMS, Real};
use glam::{DQuat, DVec3};

use super::small::{Mat3, Vec3, add, from_f64, sub, to_f64};
use super::structure::Structure;
use crate::bundle::problem::Problem;

/// The lattice that positions are anchored to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    /// Cell size, a power of two; 0 without a lattice.
    pub(super) cell: f64,
}

/// A pose as the kernels see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<T> {
    /// cam_from_world.
    pub(super) rotation: Mat3<T>,
    pub(super) center_cell: [i32; 3],
    pub(super) center: Vec3<T>,
}

/// The camera side of a state.
#[derive(Clone, Debug)]
pub(super) struct Cameras<T> {
    rotation: Vec<DQuat>,
    pub(super) center: Vec<DVec3>,
    pub(super) params: Vec<[f64; MAX_PARAMS]>,
    pub(super) views: Vec<View<T>>,
    pub(super) view_params: Vec<[T; MAX_PARAMS]>,
}

/// A pose's change from one state to another, computed from what the kernels see, so that the rounding of the state is
/// part of the step.
#[derive(Clone, Copy, Debug)]
pub(super) struct ViewChange<T> {
    pub(super) rotation: Mat3<T>,
    pub(super) center: Vec3<T>,
}

/// Points: offsets, and cells where there is a lattice.
#[derive(Clone, Debug)]
pub(super) struct Points<T> {
    pub(super) offset: Vec<Vec3<T>>,
    pub(super) cell: Vec<[i32; 3]>,
}

impl Lattice {
    /// Cells of about the median depth (`solver.md` §1.3 c), large enough that indices stay exact in `f32`.
    pub(super) fn new<T: Real>(problem: &Problem, structure: &Structure) -> Self {
        if T::EPSILON.to_f64() < 1e-10 {
            return Self { cell: 0.0 };
        }
        let mut depths: Vec<f64> = (0..structure.image.len())
            .map(|o| {
                let pose = &problem.cam_from_world[structure.image[o] as usize];
                pose.transform_point(problem.points[structure.point[o] as usize]).length()
            })
            .filter(|d| d.is_finite() && *d > 0.0)
            .collect();
        let middle = depths.len() / 2;
        let median = if depths.is_empty() { 1.0 } else { *depths.select_nth_unstable_by(middle, f64::total_cmp).1 };
        let extent = problem.points.iter().map(|p| p.abs().max_element());
        let extent = extent.chain(problem.cam_from_world.iter().map(|p| p.center().abs().max_element()));
        // 2^22: differences of two cells stay exact integers in an f32.
        let least = extent.fold(0.0, f64::max) / f64::from(1 << 22);
        Self { cell: median.max(least).log2().ceil().clamp(-500.0, 500.0).exp2() }
    }

    fn anchor<T: Real>(&self, position: DVec3) -> ([i32; 3], Vec3<T>) {
        if self.cell == 0.0 {
            return ([0; 3], from_f64(position.to_array()));
        }
        let cell = (position / self.cell).round();
        (cell.to_array().map(|c| c as i32), from_f64((position - cell * self.cell).to_array()))
    }

    /// `a − b`.
    #[inline(always)]
    pub(super) fn difference<T: Real>(
        &self,
        a: &Vec3<T>,
        a_cell: &[i32; 3],
        b: &Vec3<T>,
        b_cell: &[i32; 3],
    ) -> Vec3<T> {
        let local = sub(a, b);
        if self.cell == 0.0 {
            return local;
        }
        let cells = std::array::from_fn(|k| T::from_f64(f64::from(a_cell[k].wrapping_sub(b_cell[k])) * self.cell));
        add(&cells, &local)
    }

    pub(super) fn position<T: Real>(&self, cell: &[i32; 3], offset: &Vec3<T>) -> DVec3 {
        DVec3::from_array(to_f64(*offset)) + self.cell * DVec3::from_array(cell.map(f64::from))
    }
}

impl<T: Real> Cameras<T> {
    pub(super) fn new(problem: &Problem, lattice: &Lattice) -> Self {
        let mut params = vec![[0.0; MAX_PARAMS]; problem.cameras.len()];
        for (row, camera) in params.iter_mut().zip(&problem.cameras) {
            row[..camera.params.len()].copy_from_slice(&camera.params);
        }
        let mut cameras = Self {
            rotation: problem.cam_from_world.iter().map(|p| p.rotation.normalize()).collect(),
            center: problem.cam_from_world.iter().map(Rigid3::center).collect(),
            params,
            views: Vec::new(),
            view_params: Vec::new(),
        };
        cameras.refresh_views(lattice);
        cameras
    }

    /// Rounds the state to the working scalar. Rotations come from unit quaternions: they are orthonormal to rounding.
    fn refresh_views(&mut self, lattice: &Lattice) {
        self.views.clear();
        for (rotation, &center) in self.rotation.iter().zip(&self.center) {
            let m = glam::DMat3::from_quat(*rotation).transpose().to_cols_array();
            let (center_cell, center) = lattice.anchor(center);
            self.views.push(View { rotation: from_f64(m), center_cell, center });
        }
        self.view_params.clear();
        self.view_params.extend(self.params.iter().map(|&p| from_f64(p)));
    }

    /// The state after the camera step `x`: world-frame rotation `R exp([ω']×)`, everything else added.
    pub(super) fn stepped(&self, structure: &Structure, lattice: &Lattice, x: &[f64]) -> Self {
        let mut next = self.clone();
        for i in 0..structure.num_images() {
            let step = &x[structure.layout.range(i)];
            let dof = structure.pose_dof[i] as usize;
            if dof == 6 {
                let world = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
                next.rotation[i] = (self.rotation[i] * world).normalize();
            }
            if dof >= 3 {
                next.center[i] += DVec3::new(step[dof - 3], step[dof - 2], step[dof - 1]);
            }
        }
        for (c, free) in structure.free_params.iter().enumerate() {
            let slot = structure.param_slot[c];
            for (k, &param) in free.iter().enumerate() {
                next.params[c][param as usize] += x[structure.layout.offset(slot.block) + slot.offset + k];
            }
        }
        next.refresh_views(lattice);
        next
    }

    pub(super) fn change_to(&self, next: &Self, lattice: &Lattice) -> Vec<ViewChange<T>> {
        let change = |(a, b): (&View<T>, &View<T>)| ViewChange {
            rotation: std::array::from_fn(|k| T::from_f64(b.rotation[k].to_f64() - a.rotation[k].to_f64())),
            center: lattice.difference(&b.center, &b.center_cell, &a.center, &a.center_cell),
        };
        self.views.iter().zip(&next.views).map(change).collect()
    }

    pub(super) fn param_changes(&self, next: &Self) -> Vec<[T; MAX_PARAMS]> {
        let change = |(a, b): (&[T; MAX_PARAMS], &[T; MAX_PARAMS])| {
            std::array::from_fn(|k| T::from_f64(b[k].to_f64() - a[k].to_f64()))
        };
        self.view_params.iter().zip(&next.view_params).map(change).collect()
    }

    /// What the kernels see, exactly, in `f64`.
    pub(super) fn widened(&self) -> (Vec<View<f64>>, Vec<[f64; MAX_PARAMS]>) {
        let widen =
            |v: &View<T>| View { rotation: to_f64(v.rotation), center_cell: v.center_cell, center: to_f64(v.center) };
        (self.views.iter().map(widen).collect(), self.view_params.iter().map(|&p| to_f64(p)).collect())
    }

    pub(super) fn write(&self, problem: &mut Problem, structure: &Structure) {
        for (i, pose) in problem.cam_from_world.iter_mut().enumerate() {
            if structure.pose_dof[i] > 0 {
                let rotation = if structure.pose_dof[i] == 6 { self.rotation[i] } else { pose.rotation };
                *pose = Rigid3::from_rotation_and_center(rotation, self.center[i]);
            }
        }
        for (camera, params) in problem.cameras.iter_mut().zip(&self.params) {
            let count = camera.params.len();
            camera.params.copy_from_slice(&params[..count]);
        }
    }
}

impl<T: Real> Points<T> {
    pub(super) fn new(problem: &Problem, lattice: &Lattice) -> Self {
        let mut points = Self { offset: Vec::with_capacity(problem.points.len()), cell: Vec::new() };
        for &position in &problem.points {
            let (cell, offset) = lattice.anchor(position);
            points.offset.push(offset);
            if lattice.cell != 0.0 {
                points.cell.push(cell);
            }
        }
        points
    }

    #[inline(always)]
    pub(super) fn cell(&self, point: usize) -> &[i32; 3] {
        const ORIGIN: [i32; 3] = [0; 3];
        self.cell.get(point).unwrap_or(&ORIGIN)
    }

    pub(super) fn position(&self, point: usize, lattice: &Lattice) -> DVec3 {
        lattice.position(self.cell(point), &self.offset[point])
    }

    /// Whether a position is near enough to have a cell.
    pub(super) fn can_hold(&self, position: &Vec3<f64>, lattice: &Lattice) -> bool {
        lattice.cell == 0.0 || position.iter().all(|v| (v / lattice.cell).abs() < f64::from(1 << 22))
    }

    /// Puts a point somewhere else.
    pub(super) fn place(&mut self, point: usize, position: DVec3, lattice: &Lattice) {
        let (cell, offset) = lattice.anchor(position);
        self.offset[point] = offset;
        if let Some(slot) = self.cell.get_mut(point) {
            *slot = cell;
        }
    }

    /// Moves points that left their cell to the cell they are in; exact, as cells are powers of two.
    pub(super) fn recell(&mut self, lattice: &Lattice) {
        let size = lattice.cell;
        for (offset, cell) in self.offset.iter_mut().zip(&mut self.cell) {
            for k in 0..3 {
                let value = offset[k].to_f64();
                if value.abs() > size {
                    let cells = (value / size).round();
                    cell[k] = cell[k].saturating_add(cells as i32);
                    offset[k] = T::from_f64(value - cells * size);
                }
            }
        }
    }

    pub(super) fn write(&self, problem: &mut Problem, structure: &Structure, lattice: &Lattice) {
        for p in 0..self.offset.len() {
            if !structure.fixed_points && !structure.track(p).is_empty() {
                problem.points[p] = self.position(p, lattice);
            }
        }
    }
}
