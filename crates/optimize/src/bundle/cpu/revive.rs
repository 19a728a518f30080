//! Points that lost most of their observations are triangulated again from the current poses (source: `solver.md` §5.4.4).
//!
//! A point behind its cameras has no derivative that would bring it back. The new position is that nearest to the rays,
//! then a few Gauss–Newton steps; it is taken only if the point's share of the objective falls.

use epipole_geometry::camera::{Camera, MAX_PARAMS, Real};
use glam::{DMat3, DVec3};

use super::depth_limits::DepthLimits;
use super::point_block::{damp, fold_row, has_full_rank, solve_normal};
use super::rows::Losses;
use super::small::{Vec3, add, from_f64, rotate, row_times, sub, to_f64};
use super::state::{Cameras, Lattice, Points, View};
use super::structure::Structure;
use super::trial::residual;
use crate::active::ActiveSet;
use crate::parallel;

/// Gauss–Newton steps: the first half on all observations that project, the second on those within the limit.
const STEPS: usize = 8;
/// Damping of those steps: only against nearly parallel rays.
const LAMBDA: f64 = 1e-6;
/// Least gain in units of τ: a step with nothing but rounding to gain is none.
const LEAST_GAIN: f64 = 0.1;

/// Which points are tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Whom {
    /// Those of which fewer than two, or fewer than half, of the observations count.
    Poor,
    /// All of which any observation does not count.
    Incomplete,
}

/// Everything a new position depends on.
pub(super) struct Revival<'a> {
    pub(super) structure: &'a Structure,
    pub(super) lattice: &'a Lattice,
    pub(super) depths: &'a DepthLimits,
    pub(super) active: &'a ActiveSet,
    pub(super) losses: Losses,
    views: Vec<View<f64>>,
    centers: Vec<Vec3<f64>>,
    params: Vec<[f64; MAX_PARAMS]>,
    cameras: Vec<Camera>,
}

impl<'a> Revival<'a> {
    pub(super) fn new<T: Real>(
        structure: &'a Structure,
        lattice: &'a Lattice,
        cameras: &Cameras<T>,
        depths: &'a DepthLimits,
        active: &'a ActiveSet,
        losses: Losses,
    ) -> Self {
        let (views, params) = cameras.widened();
        let centers = views.iter().map(|v| lattice.position(&v.center_cell, &v.center).to_array()).collect();
        let camera = |(&model, params): (_, &[f64; MAX_PARAMS])| Camera {
            id: 0,
            model,
            width_px: 0,
            height_px: 0,
            params: params[..model.num_params()].to_vec(),
            has_prior_focal: false,
        };
        let cameras = structure.model.iter().zip(&params).map(camera).collect();
        Self { structure, lattice, depths, active, losses, views, centers, params, cameras }
    }

    /// Moves the points that gain by it, with their residuals.
    pub(super) fn run<T: Real, const ROWS: usize>(
        &self,
        whom: Whom,
        points: &mut Points<T>,
        residuals: &mut [[T; ROWS]],
    ) {
        if self.structure.fixed_points {
            return;
        }
        let found = parallel::map_indices(self.structure.num_points(), |p| {
            if self.lacks(p, whom) { self.better(p, points, residuals) } else { None }
        });
        for (p, position) in found.into_iter().enumerate() {
            let Some(position) = position else { continue };
            points.place(p, position, self.lattice);
            let offset = to_f64(points.offset[p]);
            for o in self.structure.track(p) {
                let view = &self.views[self.structure.image[o] as usize];
                let ray = self.lattice.difference(&offset, points.cell(p), &view.center, &view.center_cell);
                residuals[o] = from_f64(self.residual::<ROWS>(o, rotate(&view.rotation, &ray)));
            }
        }
    }

    fn lacks(&self, p: usize, whom: Whom) -> bool {
        let visible = self.structure.track(p).filter(|&o| !self.active.is_occluded(o));
        let (all, counting) = visible.fold((0, 0), |(all, n), o| (all + 1, n + usize::from(self.active.is_active(o))));
        all >= 2 && (counting < 2 || 2 * counting < all || whom == Whom::Incomplete && counting < all)
    }

    fn better<T: Real, const ROWS: usize>(
        &self,
        p: usize,
        points: &Points<T>,
        residuals: &[[T; ROWS]],
    ) -> Option<DVec3> {
        let track = self.structure.track(p);
        let before: f64 = track.map(|o| self.charge(o, &to_f64(residuals[o]))).sum();
        let mut best = (before - LEAST_GAIN * self.losses.pixel.value(self.active.limit_px().powi(2)), None);
        let mut position = self.nearest_to_rays(p)?;
        for step in 0..=STEPS {
            let (cost, next) = self.step::<ROWS>(p, &position, step > STEPS / 2);
            if cost < best.0 && points.can_hold(&position, self.lattice) {
                best = (cost, Some(DVec3::from_array(position)));
            }
            let Some(next) = next else { break };
            position = next;
        }
        best.1
    }

    /// The point whose summed squared distance to the rays of all observations is least.
    fn nearest_to_rays(&self, p: usize) -> Option<Vec3<f64>> {
        let (mut normal, mut rhs) = (DMat3::ZERO, DVec3::ZERO);
        let mut origin = None;
        for o in self.structure.track(p).filter(|&o| !self.active.is_occluded(o)) {
            let i = self.structure.image[o] as usize;
            let camera = &self.cameras[self.structure.camera[i] as usize];
            let Some(ray) = camera.ray_from_pixel(self.structure.px[o].into()) else { continue };
            let ray = DVec3::from_array(row_times(&ray.to_array(), &self.views[i].rotation));
            let across = DMat3::IDENTITY - DMat3::from_cols(ray * ray.x, ray * ray.y, ray * ray.z);
            // From the first centre, so that a far origin costs no digits.
            let center = DVec3::from_array(self.centers[i]);
            let origin = *origin.get_or_insert(center);
            normal += across;
            rhs += across * (center - origin);
        }
        let position = origin? + normal.inverse() * rhs;
        position.is_finite().then(|| position.to_array())
    }

    /// The point's share of the objective at a position, and the next one: where the pixels alone want it.
    fn step<const ROWS: usize>(&self, p: usize, position: &Vec3<f64>, within_limit: bool) -> (f64, Option<Vec3<f64>>) {
        let (mut cost, mut used) = (0.0, 0);
        let (mut triangle, mut gradient) = ([0.0; 6], [0.0; 3]);
        for o in self.structure.track(p) {
            let i = self.structure.image[o] as usize;
            let view = &self.views[i];
            let q = rotate(&view.rotation, &sub(position, &self.centers[i]));
            let r = self.residual::<ROWS>(o, q);
            cost += self.charge(o, &r);
            let s = r[0] * r[0] + r[1] * r[1];
            let counts = if within_limit { s < self.active.limit_px().powi(2) } else { s.is_finite() };
            if !counts || self.active.is_occluded(o) {
                continue;
            }
            let c = self.structure.camera[i] as usize;
            let Some(projection) = self.depths.side.differentiate(self.structure.model[c], &self.params[c], q) else {
                continue;
            };
            let weight = self.losses.pixel.weight(s);
            for k in 0..2 {
                let row = row_times(&projection.d_point[k], &view.rotation);
                gradient = add(&gradient, &row.map(|v| v * weight * r[k]));
                fold_row(&mut triangle, row.map(|v| v * weight.sqrt()));
            }
            used += 1;
        }
        let solvable = used >= 2 && has_full_rank(&triangle);
        let next = solvable.then(|| sub(position, &solve_normal(&damp(&triangle, LAMBDA.sqrt()), &gradient)));
        (cost, next.filter(|x| x.iter().all(|v| v.is_finite())))
    }

    fn residual<const ROWS: usize>(&self, o: usize, q: Vec3<f64>) -> [f64; ROWS] {
        let i = self.structure.image[o] as usize;
        let c = self.structure.camera[i] as usize;
        let least = self.depths.least(i);
        let (px, depth) = (self.structure.px[o], self.structure.depth(o));
        residual(self.depths.side, self.structure.model[c], &self.params[c], q, least, px, depth)
    }

    fn charge<const ROWS: usize>(&self, o: usize, r: &[f64; ROWS]) -> f64 {
        if self.active.is_occluded(o) {
            // Its charge does not depend on the position.
            return 0.0;
        }
        let px = [self.structure.px[o][0] + r[0], self.structure.px[o][1] + r[1]];
        let enters = self.depths.frusta.contains(self.structure.image[o] as usize, px);
        self.active.charge(o, self.losses.value(self.structure, o, r), enters)
    }
}
