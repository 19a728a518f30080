//! Residuals and derivatives at a state, one row per observation, and the products that everything else is made of.
//!
//! With rotations updated in the world frame, `dr = J_p (δX − δC + ω'×t) + J_k δk` where `t = X − C`: the derivative by
//! the whole pose follows from `J_p` and `t` (source: `scale.md` §4).

use epipole_geometry::camera::{MAX_PARAMS, Real};

use super::PIXELS;
use super::point_block::{Triangle, has_full_rank, triangle};
use super::projection::Side;
use super::rows::{Losses, depth_row};
use super::small::{Vec3, add, cross, dot, rotate, row_times, to_f64};
use super::state::{Cameras, Lattice, Points};
use super::structure::Structure;
use crate::active::ActiveSet;
use crate::lm::Observer;
use crate::loss::Loss;
use crate::parallel;

/// Points that one piece of work covers: fixed, so that sums do not depend on the number of threads.
pub(super) const POINT_GROUP: usize = 256;
/// A pose block and all parameters of its camera.
pub(super) const MAX_BLOCK: usize = 6 + MAX_PARAMS;

/// An observation's derivatives, multiplied by √w; all zero where it is inactive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row<T, const ROWS: usize> {
    /// By the point: the pixel's two rows and, with depth, the inverse depth's, zero where it is unknown.
    pub(super) point: [Vec3<T>; ROWS],
    /// X − C in the world frame.
    pub(super) ray: Vec3<T>,
    /// The residual.
    pub(super) residual: [T; ROWS],
}

/// A point's undamped block, in `f64` whatever the rows are: the reduced matrix stays positive definite only if its two
/// parts, `J_cᵀJ_c` and `E Eᵀ`, come from the same rows to more digits than the damping has.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointBlock {
    pub(super) triangle: Triangle<f64>,
    /// `J_pᵀ r`.
    pub(super) gradient: Vec3<f64>,
    /// Whether the point moves: at least two active observations that fix it.
    pub(super) free: bool,
}

/// The linearised problem.
#[derive(Clone, Debug)]
pub(super) struct Linearization<T, const ROWS: usize> {
    pub(super) rows: Vec<Row<T, ROWS>>,
    /// By the refined parameters: per observation 2 × `stride`; depth does not depend on them.
    pub(super) params: Vec<T>,
    pub(super) stride: usize,
    pub(super) points: Vec<PointBlock>,
}

/// Turns an observation with a robust loss into one with a squared loss of the same gradient and nearly the same
/// curvature: across the residual `ρ'`, along it `ρ' + 2sρ''`, but never less than a share of `ρ'` (source: Triggs et
/// al., Bundle Adjustment – A Modern Synthesis, 2000, §4.3). Weights alone make LM converge linearly in the outliers.
struct RobustTransform<T> {
    rows: [[T; 2]; 2],
    residual: T,
}

impl<T: Real> RobustTransform<T> {
    #[inline(always)]
    fn new<const ROWS: usize>(loss: Loss, floor: f64, r: &[T; ROWS]) -> Self {
        let s = (r[0] * r[0] + r[1] * r[1]).to_f64();
        let root = loss.weight(s).sqrt();
        let across = T::from_f64(root);
        let along = loss.radial_curvature(s).max(floor).sqrt();
        if along >= 1.0 {
            return Self { rows: [[across, T::ZERO], [T::ZERO, across]], residual: across };
        }
        let shrink = T::from_f64(root * (1.0 - along) / s);
        let off = -shrink * r[0] * r[1];
        Self {
            rows: [[across - shrink * r[0] * r[0], off], [off, across - shrink * r[1] * r[1]]],
            residual: T::from_f64(root / along),
        }
    }

    #[inline(always)]
    fn apply<const N: usize>(&self, rows: &[[T; N]; 2]) -> [[T; N]; 2] {
        self.rows.map(|t| std::array::from_fn(|k| t[0] * rows[0][k] + t[1] * rows[1][k]))
    }
}

impl<T: Real, const ROWS: usize> Row<T, ROWS> {
    const EMPTY: Self = Self { point: [[T::ZERO; 3]; ROWS], ray: [T::ZERO; 3], residual: [T::ZERO; ROWS] };

    /// Whether the observation takes part.
    #[inline(always)]
    pub(super) fn is_active(&self) -> bool {
        self.point[..PIXELS] != [[T::ZERO; 3]; PIXELS]
    }

    /// `J_pᵀ e`.
    #[inline(always)]
    pub(super) fn point_transposed(&self, e: [f64; ROWS]) -> Vec3<f64> {
        std::array::from_fn(|k| {
            let sum = self.point[0][k].to_f64() * e[0] + self.point[1][k].to_f64() * e[1];
            if ROWS == PIXELS { sum } else { sum + self.point[PIXELS][k].to_f64() * e[PIXELS] }
        })
    }

    /// `J_p y`.
    #[inline(always)]
    pub(super) fn point_product(&self, y: &Vec3<f64>) -> [f64; ROWS] {
        self.point.map(|row| dot(&to_f64(row), y))
    }
}

impl<T: Real, const ROWS: usize> Linearization<T, ROWS> {
    pub(super) fn new(structure: &Structure) -> Self {
        let observations = structure.image.len();
        let block = PointBlock { triangle: [0.0; 6], gradient: [0.0; 3], free: false };
        Self {
            rows: vec![Row::EMPTY; observations],
            params: vec![T::ZERO; observations * 2 * structure.param_stride],
            stride: structure.param_stride,
            points: vec![block; structure.num_points()],
        }
    }

    /// Evaluates every row at a state whose residuals are known.
    pub(super) async fn update(
        &mut self,
        structure: &Structure,
        lattice: &Lattice,
        cameras: &Cameras<T>,
        points: &Points<T>,
        residual: &[[T; ROWS]],
        active: &ActiveSet,
        losses: Losses,
        radial_floor: f64,
        side: Side,
        observer: &mut dyn Observer,
    ) {
        let stride = self.stride;
        let groups = PointGroups::new(structure);
        let rows = parallel::split_mut(&mut self.rows, &groups.observations(1));
        let params = parallel::split_mut(&mut self.params, &groups.observations(2 * stride));
        let blocks = parallel::split_mut(&mut self.points, &groups.points);
        let mut pieces: Vec<_> = rows.into_iter().zip(params).zip(blocks).collect();
        parallel::for_each_mut_breathing(&mut pieces, observer, |g, ((rows, params), blocks)| {
            let first = structure.track(groups.points[g]).start;
            let mut columns: [Vec<f64>; 3] = Default::default();
            for (block, p) in blocks.iter_mut().zip(groups.points[g]..) {
                *block = PointBlock { triangle: [0.0; 6], gradient: [0.0; 3], free: false };
                let mut count = 0;
                columns.iter_mut().for_each(Vec::clear);
                for o in structure.track(p) {
                    let local = o - first;
                    let params = &mut params[local * 2 * stride..(local + 1) * 2 * stride];
                    params.fill(T::ZERO);
                    rows[local] = Row::EMPTY;
                    if !active.is_active(o) {
                        continue;
                    }
                    let i = structure.image[o] as usize;
                    let c = structure.camera[i] as usize;
                    let view = &cameras.views[i];
                    let ray = lattice.difference(&points.offset[p], points.cell(p), &view.center, &view.center_cell);
                    let q = rotate(&view.rotation, &ray);
                    let params_of_view = &cameras.view_params[c];
                    let Some(projection) = side.differentiate(structure.model[c], params_of_view, q) else { continue };
                    let r = residual[o];
                    let transform = RobustTransform::new(losses.pixel, radial_floor, &r);
                    let row = &mut rows[local];
                    row.ray = ray;
                    (0..PIXELS).for_each(|k| row.residual[k] = r[k] * transform.residual);
                    let by_point = transform.apply(&projection.d_point);
                    for k in 0..PIXELS {
                        row.point[k] = row_times(&by_point[k], &view.rotation);
                        let wide = to_f64(row.point[k]);
                        columns.iter_mut().zip(wide).for_each(|(column, v)| column.push(v));
                        block.gradient = add(&block.gradient, &wide.map(|v| v * row.residual[k].to_f64()));
                        for (slot, &param) in params[k * stride..].iter_mut().zip(&structure.free_params[c]) {
                            let by_param = projection.d_params.map(|row| row[param as usize]);
                            *slot = transform.rows[k][0] * by_param[0] + transform.rows[k][1] * by_param[1];
                        }
                    }
                    let [_, weight] = if ROWS > PIXELS { structure.depth(o) } else { [0.0; 2] };
                    if weight > 0.0 {
                        let (by_depth, along) = robust_scales(losses.depth, radial_floor, r[PIXELS]);
                        let third_row = [view.rotation[6], view.rotation[7], view.rotation[8]];
                        row.point[PIXELS] = depth_row(q[2], weight, third_row).map(|v| v * by_depth);
                        row.residual[PIXELS] = r[PIXELS] * along;
                        let wide = to_f64(row.point[PIXELS]);
                        columns.iter_mut().zip(wide).for_each(|(column, v)| column.push(v));
                        block.gradient = add(&block.gradient, &wide.map(|v| v * row.residual[PIXELS].to_f64()));
                    }
                    count += 1;
                }
                block.triangle = triangle(&mut columns);
                block.free = !structure.fixed_points && count >= 2 && has_full_rank(&block.triangle);
            }
        })
        .await;
    }

    /// Derivatives of the pixel by the parameters of an observation's camera, both rows.
    #[inline(always)]
    pub(super) fn param_rows(&self, o: usize, count: usize) -> [&[T]; 2] {
        let start = o * 2 * self.stride;
        [&self.params[start..start + count], &self.params[start + self.stride..start + self.stride + count]]
    }

    /// `J_c x` for a pose step (world rotation, centre) and a parameter step.
    #[inline(always)]
    pub(super) fn camera_product(&self, o: usize, pose: &([T; 3], [T; 3]), params: &[T]) -> [T; ROWS] {
        let row = &self.rows[o];
        let moved = cross(&pose.0, &row.ray);
        let moved = [moved[0] - pose.1[0], moved[1] - pose.1[1], moved[2] - pose.1[2]];
        let by_params = self.param_rows(o, params.len());
        std::array::from_fn(|k| {
            let mut sum = dot(&row.point[k], &moved);
            if k < PIXELS {
                for (a, b) in by_params[k].iter().zip(params) {
                    sum += *a * *b;
                }
            }
            sum
        })
    }

    /// `J_cᵀ e`: by the world rotation and by the centre.
    #[inline(always)]
    pub(super) fn pose_transposed(&self, o: usize, e: [f64; ROWS]) -> ([f64; 3], [f64; 3]) {
        let row = &self.rows[o];
        let g = row.point_transposed(e);
        (cross(&to_f64(row.ray), &g), g.map(|v| -v))
    }
}

/// [`RobustTransform`] of a single row: what its derivatives are multiplied by, and its residual.
#[inline(always)]
fn robust_scales<T: Real>(loss: Loss, floor: f64, r: T) -> (T, T) {
    let s = r.to_f64().powi(2);
    let root = loss.weight(s).sqrt();
    let along = loss.radial_curvature(s).max(floor).sqrt().min(1.0);
    (T::from_f64(root * along), T::from_f64(root / along))
}

/// Points cut into groups of fixed size.
#[derive(Debug)]
pub(super) struct PointGroups<'a> {
    structure: &'a Structure,
    /// Group `g` covers points `points[g]..points[g + 1]`.
    pub(super) points: Vec<usize>,
}

impl<'a> PointGroups<'a> {
    pub(super) fn new(structure: &'a Structure) -> Self {
        let count = structure.num_points();
        Self { structure, points: (0..count).step_by(POINT_GROUP).chain([count]).collect() }
    }

    /// Where the groups' observations begin, in an array with `width` entries per observation.
    pub(super) fn observations(&self, width: usize) -> Vec<usize> {
        self.points.iter().map(|&p| self.structure.track_start[p] as usize * width).collect()
    }
}
