//! The second level of the preconditioner for a bundle problem: when there is one, and when it is made anew.

use epipole_geometry::camera::Real;
use glam::DVec3;

use super::elimination::{DampedPoint, point_factors};
use super::linearization::Linearization;
use super::normal::CameraNormal;
use super::structure::Structure;
use crate::bundle::options::{Options, Preconditioner};
use crate::reduced::coarse::{
    Basis, CoarseMatrix, CoarseSpace, MAX_GROUPS, MIN_IMAGES, Memberships, REBUILD_AFTER, STEPS_AT_LIMIT, memberships,
};

/// Relative shift of the coarse matrix's diagonal, which free gauges leave without content (source: `scale.md` §3.4).
const SHIFT: f64 = 1e-10;

/// The second level, or what decides whether there will be one.
#[derive(Debug)]
pub(super) struct SecondLevel {
    wanted: bool,
    /// May still become wanted.
    may_start: bool,
    steps_at_limit: usize,
    memberships: Option<Memberships>,
    space: Option<CoarseSpace>,
    age: usize,
}

impl SecondLevel {
    pub(super) fn new(structure: &Structure, options: &Options) -> Self {
        let wanted = match options.preconditioner {
            Preconditioner::SchurJacobi => false,
            Preconditioner::TwoLevel => true,
            Preconditioner::Auto => structure.num_images() >= MIN_IMAGES,
        };
        let may_start = options.preconditioner == Preconditioner::Auto;
        Self { wanted, may_start, steps_at_limit: 0, memberships: None, space: None, age: 0 }
    }

    /// The space for a step, as old as [`REBUILD_AFTER`] allows.
    pub(super) fn at<T: Real, const ROWS: usize>(
        &mut self,
        structure: &Structure,
        linearization: &Linearization<T, ROWS>,
        normal: &CameraNormal,
        damped: &[DampedPoint],
        centers: &[DVec3],
        lambda: f64,
    ) -> Option<&CoarseSpace> {
        if !self.wanted {
            return None;
        }
        if self.space.is_none() || self.age >= REBUILD_AFTER {
            let memberships = self
                .memberships
                .get_or_insert_with(|| memberships(structure.num_images(), &structure.track_start, &structure.image));
            self.space = build(structure, linearization, normal, damped, centers, lambda, memberships);
            self.age = 0;
        }
        self.age += 1;
        self.space.as_ref()
    }

    /// Learns what a step took.
    pub(super) fn took(&mut self, iterations: usize, limit: usize) {
        self.steps_at_limit = if iterations >= limit { self.steps_at_limit + 1 } else { 0 };
        self.wanted |= self.may_start && self.steps_at_limit >= STEPS_AT_LIMIT;
    }
}

fn build<T: Real, const ROWS: usize>(
    structure: &Structure,
    linearization: &Linearization<T, ROWS>,
    normal: &CameraNormal,
    damped: &[DampedPoint],
    centers: &[DVec3],
    lambda: f64,
    memberships: &Memberships,
) -> Option<CoarseSpace> {
    let layout = &structure.layout;
    let groups: Vec<usize> = (structure.num_images()..layout.num_blocks()).filter(|&b| layout.size(b) > 0).collect();
    let groups = if groups.len() > MAX_GROUPS { &[] } else { groups.as_slice() };
    let basis = Basis::new(layout, memberships, centers, &structure.pose_dof, groups, &normal.removed);
    let mut matrix = CoarseMatrix::zeros(basis.dim);
    normal.project(structure, lambda, &basis, &mut matrix);
    if !structure.fixed_points {
        let fill = |p: usize, factors: &mut [f64]| point_factors(structure, linearization, &damped[p], p, factors);
        matrix.subtract_points(&basis, layout, &structure.incidence, fill);
    }
    matrix.inverse(SHIFT).map(|inverse| CoarseSpace::new(basis, inverse))
}
