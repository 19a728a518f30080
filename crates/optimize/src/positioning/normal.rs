//! The linear step: points are eliminated exactly, the centres solved by Cholesky or conjugate gradients.

use std::sync::Arc;

use epipole_geometry::camera::Real;

use super::block::Block;
use super::layout::Layout;
use super::triangle::{Triangle, floored};
use super::vec3::{Vec3, add, dot, scale, sub, zero};
use crate::lm::{Observer, breath};
use crate::parallel;
use crate::reduced::{
    BlockJacobi, BlockLayout, BlockMatrix, BlockPattern, Cholesky, Incidence, LinearOperator, PcgOptions, pcg,
};

/// Block products per second and multiply-adds per second of one core, for choosing the method only
/// (measured on bonsai292; compare `reference/scale.md` §5, whose blocks are 6×6).
const PAIRS_PER_SECOND: f64 = 60e6;
const MULTIPLY_ADDS_PER_SECOND: f64 = 1e10;
/// Observations per second of one product with the operator, and how many products a step takes.
const OBSERVATIONS_PER_SECOND: f64 = 40e6;
const PRODUCTS_PER_STEP: f64 = 20.0;
/// An exact step saves later steps, so it may cost this much more than an inexact one (`scale.md` §5).
const CHOLESKY_BONUS: f64 = 1.5;

/// How the reduced system is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinearSolver {
    /// By estimated cost; conjugate gradients where the scalar is `f32`.
    #[default]
    Auto,
    /// Formed explicitly in `f64` and factorised, dense or sparse.
    Cholesky,
    /// Never formed; conjugate gradients with the Schur–Jacobi preconditioner and the quadratic-model stop.
    ConjugateGradients,
}

/// Which blocks the step meets: with all scales held every block is a multiple of the identity, and the three
/// coordinates share one scalar matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// All directions zero.
    Isotropic,
    /// Any.
    Full,
}

/// A step of all unknowns.
#[derive(Clone, Debug)]
pub(crate) struct Step<T> {
    /// δC per camera.
    pub(crate) centers: Vec<Vec3<T>>,
    /// δX per point.
    pub(crate) points: Vec<Vec3<T>>,
    /// Decrease of the undamped quadratic model.
    pub(crate) predicted_decrease: f64,
    /// Products with the operator; 0 for a factorisation.
    pub(crate) inner_iterations: usize,
}

/// The normal equations of one linearisation, and the memory to solve them at any damping.
pub(crate) struct Normal<T> {
    shape: Shape,
    matrix: BlockMatrix,
    /// `None`: conjugate gradients.
    cholesky: Option<Cholesky>,
    incidence: Incidence,
    /// Per point: the undamped triangle and the sum of gradients.
    triangle: Vec<Triangle<T>>,
    point_gradient: Vec<Vec3<T>>,
    /// Per camera: sum of the blocks (00, 01, 02, 11, 12, 22).
    camera_block: Vec<[f64; 6]>,
    /// Per point at the current damping: inverse triangle, and `C⁻¹ g`.
    inverse: Vec<Triangle<T>>,
    shift: Vec<Vec3<T>>,
}

impl<T: Real> Normal<T> {
    /// Chooses the method and analyses the pattern. `None` if the analysis runs out of memory.
    pub(crate) async fn new(
        layout: &Layout,
        shape: Shape,
        solver: LinearSolver,
        observer: &mut dyn Observer,
    ) -> Option<Self> {
        let size = match shape {
            Shape::Isotropic => 1,
            Shape::Full => 3,
        };
        let (point_start, block) = participants(layout);
        let products = PRODUCTS_PER_STEP * layout.observations() as f64 / OBSERVATIONS_PER_SECOND;
        let budget = match solver {
            // The gauge is held by damping of 1e-8 alone, which an f32 factor cannot see.
            LinearSolver::Auto if T::EPSILON.to_f64() > 1e-10 => 0.0,
            LinearSolver::Auto => CHOLESKY_BONUS * products,
            LinearSolver::Cholesky => f64::INFINITY,
            LinearSolver::ConjugateGradients => 0.0,
        };
        let assembly = layout.pairs() / PAIRS_PER_SECOND;
        if assembly < budget {
            let blocks = BlockLayout::new(vec![size; layout.cameras()]);
            let incidence = Incidence::new(&blocks, point_start.clone(), block.clone())?;
            breath(observer).await;
            let pattern = Arc::new(BlockPattern::from_incidence(&blocks, &incidence));
            breath(observer).await;
            let cholesky = Cholesky::new(&pattern).ok()?;
            if assembly + cholesky.flops() / MULTIPLY_ADDS_PER_SECOND < budget {
                return Some(Self::with(shape, pattern, Some(cholesky), incidence, layout));
            }
        }
        let blocks = BlockLayout::new(vec![3; layout.cameras()]);
        let incidence = Incidence::new(&blocks, point_start, block)?;
        let pattern = Arc::new(BlockPattern::diagonal(&blocks));
        Some(Self::with(Shape::Full, pattern, None, incidence, layout))
    }

    fn with(
        shape: Shape,
        pattern: Arc<BlockPattern>,
        cholesky: Option<Cholesky>,
        incidence: Incidence,
        layout: &Layout,
    ) -> Self {
        Self {
            shape,
            matrix: BlockMatrix::zeros(pattern),
            cholesky,
            incidence,
            triangle: vec![Triangle::zero(); layout.points()],
            point_gradient: vec![zero(); layout.points()],
            camera_block: vec![[0.0; 6]; layout.cameras()],
            inverse: vec![Triangle::zero(); layout.points()],
            shift: vec![zero(); layout.points()],
        }
    }

    /// Takes over a new linearisation.
    pub(crate) async fn gather(&mut self, layout: &Layout, blocks: &[Block<T>], observer: &mut dyn Observer) {
        let sizes = layout.point_offsets();
        let triangles = parallel::split_mut(&mut self.triangle, &sizes);
        let gradients = parallel::split_mut(&mut self.point_gradient, &sizes);
        let mut work: Vec<_> = triangles.into_iter().zip(gradients).collect();
        parallel::for_each_mut_breathing(&mut work, observer, |chunk, (triangles, gradients)| {
            for (k, point) in layout.chunks[chunk].clone().enumerate() {
                (triangles[k], gradients[k]) = gather_point(&blocks[layout.track(point)]);
            }
        })
        .await;
        self.camera_block = layout.map_cameras(|camera| {
            let mut sum = [0.0; 6];
            for &o in layout.of_camera(camera) {
                let block = &blocks[o as usize];
                let square = block.scale.to_f64() * block.scale.to_f64();
                let [x, y, z] = block.direction.map(T::to_f64);
                let entries = [1.0 - x * x, -x * y, -x * z, 1.0 - y * y, -y * z, 1.0 - z * z];
                sum.iter_mut().zip(entries).for_each(|(s, e)| *s += square * e);
            }
            sum
        });
    }

    /// The step of the model damped with `λ diag(JᵀJ)`; `None` when the reduced matrix has no factor or the step is not
    /// finite, or the observer asks to stop.
    pub(crate) async fn solve(
        &mut self,
        layout: &Layout,
        blocks: &[Block<T>],
        lambda: f64,
        observer: &mut dyn Observer,
    ) -> Option<Step<T>> {
        self.damp_points(layout, T::from_f64(lambda));
        let rhs = layout.map_cameras(|camera| {
            let mut sum = [0.0; 3];
            for &o in layout.of_camera(camera) {
                let (block, point) = (&blocks[o as usize], layout.point[o as usize] as usize);
                let part = sub(block.gradient, block.apply(self.shift[point]));
                sum = add(sum, part.map(T::to_f64));
            }
            sum
        });
        self.assemble(layout, blocks, lambda, observer).await;
        if observer.should_stop() {
            return None;
        }
        let (centers, inner_iterations) = match self.shape {
            Shape::Isotropic => (self.solve_coordinates(&rhs, observer).await?, 0),
            Shape::Full => self.solve_blocks(layout, blocks, &rhs, lambda, observer).await?,
        };
        let step = self.substitute(layout, blocks, centers, inner_iterations, observer).await;
        Some(step).filter(|step| {
            step.predicted_decrease.is_finite() && step.centers.iter().flatten().all(|value| value.is_finite())
        })
    }

    /// Largest step of a centre's coordinate in units of its column scale.
    pub(crate) fn max_scaled_step(&self, step: &Step<T>) -> f64 {
        let scaled = step.centers.iter().zip(&self.camera_block).flat_map(|(step, b)| {
            let diagonal = [b[0], b[3], b[5]];
            std::array::from_fn::<f64, 3, _>(|k| diagonal[k].max(0.0).sqrt() * step[k].to_f64().abs())
        });
        scaled.fold(0.0, f64::max)
    }

    fn damp_points(&mut self, layout: &Layout, lambda: T) {
        let sizes = layout.point_offsets();
        let inverses = parallel::split_mut(&mut self.inverse, &sizes);
        let shifts = parallel::split_mut(&mut self.shift, &sizes);
        let mut work: Vec<_> = inverses.into_iter().zip(shifts).collect();
        let (triangle, gradient) = (&self.triangle, &self.point_gradient);
        parallel::for_each_mut(&mut work, |chunk, (inverses, shifts)| {
            for (k, point) in layout.chunks[chunk].clone().enumerate() {
                inverses[k] = triangle[point].damped(lambda).inverse();
                shifts[k] = inverses[k].apply(inverses[k].apply_transpose(gradient[point]));
            }
        });
    }

    /// The reduced matrix, or its block diagonal for the preconditioner.
    async fn assemble(&mut self, layout: &Layout, blocks: &[Block<T>], lambda: f64, observer: &mut dyn Observer) {
        self.matrix.fill_zero();
        for (camera, b) in self.camera_block.iter().enumerate() {
            let [d0, d1, d2] = floored([b[0], b[3], b[5]]).map(|d| lambda * d);
            match self.shape {
                Shape::Isotropic => self.matrix.add_to_block(camera, camera, &[b[0] + d0]),
                Shape::Full => {
                    let full = [b[0] + d0, b[1], b[2], b[1], b[3] + d1, b[4], b[2], b[4], b[5] + d2];
                    self.matrix.add_to_block(camera, camera, &full);
                }
            }
        }
        let stride = self.matrix.pattern().layout().factor_stride();
        let (inverse, shape) = (&self.inverse, self.shape);
        let fill = |point: usize, factors: &mut [f64]| {
            let inverse = Triangle(inverse[point].0.map(T::to_f64));
            let track = layout.track(point);
            let mut participant = 0;
            for o in track.clone() {
                // Two observations of one camera are one participant.
                if o > track.start && layout.camera[o] != layout.camera[o - 1] {
                    participant += 1;
                }
                let rows = &mut factors[participant * 3 * stride..][..3 * stride];
                let block = &blocks[o];
                let square = block.scale.to_f64() * block.scale.to_f64();
                match shape {
                    Shape::Isotropic => rows[0] += square * inverse.0[0],
                    Shape::Full => add_factor(rows, stride, &inverse, square, block.direction.map(T::to_f64)),
                }
            }
        };
        self.matrix.subtract_points(&self.incidence, fill, observer).await;
        self.matrix.replace_empty_columns_by_identity();
    }

    async fn solve_coordinates(&mut self, rhs: &[Vec3<f64>], observer: &mut dyn Observer) -> Option<Vec<Vec3<T>>> {
        let cholesky = self.cholesky.as_mut()?;
        let mut centers = vec![zero(); rhs.len()];
        for axis in 0..3 {
            let column: Vec<f64> = rhs.iter().map(|r| r[axis]).collect();
            let x = cholesky.solve(&self.matrix, &column, observer).await.ok()?;
            for (center, value) in centers.iter_mut().zip(x) {
                center[axis] = T::from_f64(value);
            }
        }
        Some(centers)
    }

    async fn solve_blocks(
        &mut self,
        layout: &Layout,
        blocks: &[Block<T>],
        rhs: &[Vec3<f64>],
        lambda: f64,
        observer: &mut dyn Observer,
    ) -> Option<(Vec<Vec3<T>>, usize)> {
        let (x, iterations) = match &mut self.cholesky {
            Some(cholesky) => (cholesky.solve(&self.matrix, rhs.as_flattened(), observer).await.ok()?, 0),
            None => {
                let preconditioner = BlockJacobi::new(&self.matrix);
                let damping =
                    self.camera_block.iter().map(|b| floored([b[0], b[3], b[5]]).map(|d| lambda * d)).collect();
                let (triangle, inverse) = (&self.triangle, &self.inverse);
                let mut operator = Operator { layout, blocks, triangle, inverse, lambda, damping };
                let precondition = |r: &[f64], z: &mut [f64]| preconditioner.apply(r, z);
                let options = PcgOptions::default();
                let result = pcg(&mut operator, precondition, rhs.as_flattened(), &options, observer).await;
                (result.x, result.iterations)
            }
        };
        Some((x.as_chunks::<3>().0.iter().map(|c| c.map(T::from_f64)).collect(), iterations))
    }

    /// The points' part of the step, `δX = C⁻¹ (Σ M δC − g)`, and what the model promises.
    async fn substitute(
        &self,
        layout: &Layout,
        blocks: &[Block<T>],
        centers: Vec<Vec3<T>>,
        inner_iterations: usize,
        observer: &mut dyn Observer,
    ) -> Step<T> {
        let mut points = vec![zero(); layout.points()];
        let pieces = parallel::split_mut(&mut points, &layout.point_offsets());
        let mut work: Vec<_> = pieces.into_iter().map(|piece| (piece, 0.0f64)).collect();
        let half = T::from_f64(0.5);
        parallel::for_each_mut_breathing(&mut work, observer, |chunk, (piece, model)| {
            for (k, point) in layout.chunks[chunk].clone().enumerate() {
                let track = layout.track(point);
                let mut right = scale(self.point_gradient[point], -T::ONE);
                for o in track.clone() {
                    right = add(right, blocks[o].apply(centers[layout.camera[o] as usize]));
                }
                let step = self.inverse[point].apply(self.inverse[point].apply_transpose(right));
                piece[k] = step;
                for o in track {
                    let e = sub(step, centers[layout.camera[o] as usize]);
                    let root = blocks[o].apply_root(e);
                    *model += (dot(blocks[o].gradient, e) + half * dot(root, root)).to_f64();
                }
            }
        })
        .await;
        let predicted_decrease = -work.iter().map(|(_, model)| model).sum::<f64>();
        Step { centers, points, predicted_decrease, inner_iterations }
    }
}

fn gather_point<T: Real>(track: &[Block<T>]) -> (Triangle<T>, Vec3<T>) {
    let mut triangle = Triangle::zero();
    let mut gradient = zero();
    // Multiples of the identity add up before they are folded: three rotations instead of three per observation.
    let mut isotropic = T::ZERO;
    for block in track {
        gradient = add(gradient, block.gradient);
        if block.direction == zero() {
            isotropic += block.scale * block.scale;
        } else {
            block.fold_into(&mut triangle);
        }
    }
    if isotropic > T::ZERO {
        Block { direction: zero(), scale: isotropic.sqrt(), gradient: zero() }.fold_into(&mut triangle);
    }
    (triangle, gradient)
}

/// Adds `Eᵀ = R⁻ᵀ M`, `M = square (I − direction directionᵀ)`.
#[inline(always)]
fn add_factor(rows: &mut [f64], stride: usize, inverse: &Triangle<f64>, square: f64, direction: Vec3<f64>) {
    let [i00, i01, i02, i11, i12, i22] = inverse.0;
    let root = [[i00, 0.0, 0.0], [i01, i11, 0.0], [i02, i12, i22]];
    for (k, root) in root.iter().enumerate() {
        let along = dot(*root, direction);
        for c in 0..3 {
            rows[k * stride + c] += square * (root[c] - along * direction[c]);
        }
    }
}

/// Distinct cameras per point, as [`Incidence`] wants them.
fn participants(layout: &Layout) -> (Vec<u32>, Vec<u32>) {
    let mut start = Vec::with_capacity(layout.points() + 1);
    let mut block = Vec::with_capacity(layout.observations());
    start.push(0);
    for point in 0..layout.points() {
        let begin = block.len();
        for &camera in &layout.camera[layout.track(point)] {
            if block[begin..].last() != Some(&camera) {
                block.push(camera);
            }
        }
        start.push(block.len() as u32);
    }
    (start, block)
}

/// `S p` without forming `S`: forward to each point, back to each camera. Its curvature is a sum of squares, which stays
/// positive in `f32` (`reference/solver.md` §1.3 a).
struct Operator<'a, T> {
    layout: &'a Layout,
    blocks: &'a [Block<T>],
    triangle: &'a [Triangle<T>],
    inverse: &'a [Triangle<T>],
    lambda: f64,
    /// λ diag(B) per camera.
    damping: Vec<Vec3<f64>>,
}

impl<T: Real> Operator<'_, T> {
    /// The points' answer `y` to a step `p` of the centres, and `λ ‖y‖²` in the points' damping.
    fn points(&self, p: &[Vec3<T>]) -> (Vec<Vec3<T>>, f64) {
        let layout = self.layout;
        let chunks = parallel::map_indices(layout.chunks.len(), |chunk| {
            let mut curvature = 0.0;
            let answer = layout.chunks[chunk].clone().map(|point| {
                let mut z = zero();
                for o in layout.track(point) {
                    z = add(z, self.blocks[o].apply(p[layout.camera[o] as usize]));
                }
                let y = self.inverse[point].apply(self.inverse[point].apply_transpose(z));
                let diagonal = self.triangle[point].damping_diagonal();
                curvature += (0..3).map(|k| (diagonal[k] * y[k] * y[k]).to_f64()).sum::<f64>();
                y
            });
            (answer.collect::<Vec<_>>(), curvature)
        });
        let curvature = self.lambda * chunks.iter().map(|(_, curvature)| curvature).sum::<f64>();
        (chunks.into_iter().flat_map(|(answer, _)| answer).collect(), curvature)
    }
}

impl<T: Real> LinearOperator for Operator<'_, T> {
    fn apply(&mut self, x: &[f64], out: &mut [f64]) -> f64 {
        let layout = self.layout;
        let x: &[Vec3<f64>] = x.as_chunks::<3>().0;
        let p: Vec<Vec3<T>> = x.iter().map(|p| p.map(T::from_f64)).collect();
        let (y, mut curvature) = self.points(&p);
        let rows = layout.map_cameras(|camera| {
            let mut sum = zero::<T>();
            let mut squares = T::ZERO;
            for &o in layout.of_camera(camera) {
                let (block, point) = (&self.blocks[o as usize], layout.point[o as usize] as usize);
                let root = block.apply_root(sub(p[camera], y[point]));
                sum = add(sum, scale(root, block.scale));
                squares += dot(root, root);
            }
            (sum.map(T::to_f64), squares.to_f64())
        });
        let out = out.as_chunks_mut::<3>().0;
        for (camera, (row, squares)) in rows.into_iter().enumerate() {
            curvature += squares;
            for k in 0..3 {
                let damped = self.damping[camera][k] * x[camera][k];
                out[camera][k] = row[k] + damped;
                curvature += damped * x[camera][k];
            }
        }
        curvature
    }
}
