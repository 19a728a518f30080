//! The camera side of the normal equations before any point is eliminated: one small dense block per image.

use epipole_geometry::camera::Real;

use super::PIXELS;
use super::linearization::{Linearization, MAX_BLOCK};
use super::structure::Structure;
use crate::bundle::problem::ParamPrior;
use crate::lm::Observer;
use crate::parallel;
use crate::reduced::coarse::{Basis, CoarseMatrix};
use crate::reduced::{BlockMatrix, Vectorized, dispatch};

/// An image with fewer active observations stays where it is (source: `solver.md` §5.4).
const MIN_OBSERVATIONS: usize = 6;
/// A column this much smaller than the median of its kind says nothing (source: `solver.md` §5.1).
const DEGENERATE: f64 = 1e-12;

/// `J_cᵀJ_c` and `J_cᵀr` of one image, by its pose's unknowns and its camera's.
#[derive(Clone, Debug)]
struct ImageBlock {
    size: usize,
    /// Row-major, `size × size`.
    normal: Vec<f64>,
    gradient: Vec<f64>,
    active: usize,
}

/// The camera side at one linearisation.
#[derive(Clone, Debug)]
pub(super) struct CameraNormal {
    images: Vec<ImageBlock>,
    /// `diag(JᵀJ)` of every unknown, priors included: the column scales of damping.
    pub(super) diagonal: Vec<f64>,
    /// `J_cᵀ r`.
    gradient: Vec<f64>,
    /// Gradient of the priors.
    prior_gradient: Vec<f64>,
    prior_diagonal: Vec<f64>,
    /// Unknowns without enough observations: their columns are out of the system until they have.
    pub(super) removed: Vec<bool>,
}

impl CameraNormal {
    pub(super) async fn new<T: Real, const ROWS: usize>(
        structure: &Structure,
        linearization: &Linearization<T, ROWS>,
        priors: &[Vec<ParamPrior>],
        params: &[[f64; epipole_geometry::camera::MAX_PARAMS]],
        observer: &mut dyn Observer,
    ) -> Self {
        let block = |i| image_block(structure, linearization, i);
        let images = parallel::map_indices_breathing(structure.num_images(), observer, block).await;
        let dim = structure.layout.dim();
        let (mut prior_gradient, mut prior_diagonal) = (vec![0.0; dim], vec![0.0; dim]);
        for (c, priors) in priors.iter().enumerate() {
            for prior in priors {
                let Some(k) = structure.free_params[c].iter().position(|&p| p as usize == prior.index) else {
                    continue;
                };
                let slot = structure.param_slot[c];
                let at = structure.layout.offset(slot.block) + slot.offset + k;
                let information = prior.sigma.powi(-2);
                prior_gradient[at] += information * (params[c][prior.index] - prior.mean);
                prior_diagonal[at] += information;
            }
        }
        let mut normal = Self {
            images,
            diagonal: prior_diagonal.clone(),
            gradient: vec![0.0; dim],
            prior_gradient,
            prior_diagonal,
            removed: vec![false; dim],
        };
        normal.collect_diagonal(structure);
        normal.remove_weak(structure);
        normal
    }

    fn collect_diagonal(&mut self, structure: &Structure) {
        for (i, block) in self.images.iter().enumerate() {
            for k in 0..block.size {
                let at = unknown(structure, i, k);
                self.diagonal[at] += block.normal[k * (block.size + 1)];
                self.gradient[at] += block.gradient[k];
            }
        }
    }

    fn remove_weak(&mut self, structure: &Structure) {
        let mut kinds = [Vec::new(), Vec::new()];
        for i in 0..structure.num_images() {
            let dof = structure.pose_dof[i] as usize;
            for k in 0..dof {
                kinds[usize::from(k + 3 >= dof)].push(self.diagonal[unknown(structure, i, k)]);
            }
        }
        let median = kinds.map(|mut kind| {
            let middle = kind.len() / 2;
            if kind.is_empty() { 0.0 } else { *kind.select_nth_unstable_by(middle, f64::total_cmp).1 }
        });
        for (i, block) in self.images.iter().enumerate() {
            let dof = structure.pose_dof[i] as usize;
            let own = if structure.owns_params(i) { block.size } else { dof };
            let weak = block.active < MIN_OBSERVATIONS || 2 * block.active < own;
            for k in 0..dof {
                let at = unknown(structure, i, k);
                self.removed[at] = weak || self.diagonal[at] <= DEGENERATE * median[usize::from(k + 3 >= dof)];
            }
            for k in dof..own {
                let at = unknown(structure, i, k);
                self.removed[at] = weak && self.prior_diagonal[at] == 0.0;
            }
        }
        for (removed, &diagonal) in self.removed.iter_mut().zip(&self.diagonal) {
            *removed |= diagonal <= 0.0 || !diagonal.is_finite();
        }
    }

    /// Whether any unknown is left.
    pub(super) fn is_empty(&self) -> bool {
        self.removed.iter().all(|&r| r)
    }

    /// `matrix += B + λ diag(B)`, priors included.
    pub(super) fn add_to(&self, structure: &Structure, lambda: f64, matrix: &mut BlockMatrix) {
        let mut part = Vec::new();
        for (i, block) in self.images.iter().enumerate() {
            let dof = structure.pose_dof[i] as usize;
            let slot = structure.param_slot[structure.camera[i] as usize];
            let own = if slot.block == i { block.size } else { dof };
            let mut add = |rows: std::ops::Range<usize>, columns: std::ops::Range<usize>, at: (usize, usize)| {
                part.clear();
                for row in rows {
                    part.extend_from_slice(
                        &block.normal[row * block.size + columns.start..row * block.size + columns.end],
                    );
                }
                if !part.is_empty() {
                    matrix.add_to_block(at.0, at.1, &part);
                }
            };
            add(0..own, 0..own, (i, i));
            if own < block.size {
                add(0..dof, dof..block.size, (i, slot.block));
                add(dof..block.size, dof..block.size, (slot.block, slot.block));
            }
        }
        matrix.add_diagonal(&self.added_diagonal(lambda));
    }

    /// `coarse += Zᵀ (B + λ diag(B)) Z`, priors included.
    pub(super) fn project(&self, structure: &Structure, lambda: f64, basis: &Basis, coarse: &mut CoarseMatrix) {
        for (i, block) in self.images.iter().enumerate() {
            let dof = structure.pose_dof[i] as usize;
            let slot = structure.param_slot[structure.camera[i] as usize];
            let place = |k: usize| if k < dof { (i, k) } else { (slot.block, slot.offset + k - dof) };
            let rows: Vec<_> = (0..block.size).map(place).collect();
            coarse.add_projected(basis, &rows, &block.normal);
        }
        coarse.add_diagonal(basis, &structure.layout, &self.added_diagonal(lambda));
    }

    /// What comes on top of `J_cᵀJ_c`: damping and priors.
    pub(super) fn added_diagonal(&self, lambda: f64) -> Vec<f64> {
        self.diagonal.iter().zip(&self.prior_diagonal).map(|(d, p)| lambda * d + p).collect()
    }

    /// `−J_cᵀ r − ∇prior`: the right-hand side before points are eliminated.
    pub(super) fn right_hand_side(&self) -> Vec<f64> {
        self.gradient.iter().zip(&self.prior_gradient).map(|(gradient, prior)| -gradient - prior).collect()
    }

    /// Sets the entries of removed unknowns to 0.
    pub(super) fn clear_removed(&self, rhs: &mut [f64]) {
        rhs.iter_mut().zip(&self.removed).filter(|(_, removed)| **removed).for_each(|(value, _)| *value = 0.0);
    }

    /// The priors' part of the predicted decrease for a step.
    pub(super) fn prior_decrease(&self, x: &[f64]) -> f64 {
        let terms = x.iter().zip(&self.prior_gradient).zip(&self.prior_diagonal);
        -terms.map(|((x, g), h)| x * (g + 0.5 * h * x)).sum::<f64>()
    }
}

/// `J_cᵀ e`, images in parallel, each summing its observations in ascending order.
pub(super) fn transposed_product<T: Real, const ROWS: usize>(
    structure: &Structure,
    linearization: &Linearization<T, ROWS>,
    error: impl Fn(usize) -> [f64; ROWS] + Sync + Send,
) -> Vec<f64> {
    let sums = parallel::map_indices(structure.num_images(), |i| {
        let dof = structure.pose_dof[i] as usize;
        let count = structure.free_params[structure.camera[i] as usize].len();
        let mut sum = [0.0f64; MAX_BLOCK];
        for &o in structure.observations_of(i) {
            let e = error(o as usize);
            let (rotation, center) = linearization.pose_transposed(o as usize, e);
            if dof == 6 {
                (0..3).for_each(|k| sum[k] += rotation[k]);
            }
            if dof >= 3 {
                (0..3).for_each(|k| sum[dof - 3 + k] += center[k]);
            }
            let [a, b] = linearization.param_rows(o as usize, count);
            for k in 0..count {
                sum[dof + k] += a[k].to_f64() * e[0] + b[k].to_f64() * e[1];
            }
        }
        sum
    });
    let mut out = vec![0.0; structure.layout.dim()];
    for (i, sum) in sums.iter().enumerate() {
        let size = structure.pose_dof[i] as usize + structure.free_params[structure.camera[i] as usize].len();
        for k in 0..size {
            out[unknown(structure, i, k)] += sum[k];
        }
    }
    out
}

/// The unknown behind row `k` of an image's block: pose first, then its camera's parameters wherever they lie.
fn unknown(structure: &Structure, image: usize, k: usize) -> usize {
    let dof = structure.pose_dof[image] as usize;
    if k < dof {
        structure.layout.offset(image) + k
    } else {
        let slot = structure.param_slot[structure.camera[image] as usize];
        structure.layout.offset(slot.block) + slot.offset + k - dof
    }
}

fn image_block<T: Real, const ROWS: usize>(
    structure: &Structure,
    linearization: &Linearization<T, ROWS>,
    i: usize,
) -> ImageBlock {
    let dof = structure.pose_dof[i] as usize;
    let size = dof + structure.free_params[structure.camera[i] as usize].len();
    let mut block = ImageBlock { size, normal: vec![0.0; size * size], gradient: vec![0.0; size], active: 0 };
    let mut sum = Accumulate { structure, linearization, i, size, block: &mut block };
    match size {
        0 => sum.count_active(),
        1..=4 => dispatch(sum.padded::<4>()),
        5..=8 => dispatch(sum.padded::<8>()),
        9..=12 => dispatch(sum.padded::<12>()),
        _ => dispatch(sum.padded::<24>()),
    }
    block
}

struct Accumulate<'a, T, const ROWS: usize> {
    structure: &'a Structure,
    linearization: &'a Linearization<T, ROWS>,
    i: usize,
    size: usize,
    block: &'a mut ImageBlock,
}

struct Padded<'a, T, const ROWS: usize, const N: usize>(Accumulate<'a, T, ROWS>);

impl<'a, T: Real, const ROWS: usize> Accumulate<'a, T, ROWS> {
    fn padded<const N: usize>(self) -> Padded<'a, T, ROWS, N> {
        Padded(self)
    }

    fn count_active(&mut self) {
        let rows = &self.linearization.rows;
        let observations = self.structure.observations_of(self.i);
        self.block.active = observations.iter().filter(|&&o| rows[o as usize].is_active()).count();
    }
}

impl<T: Real, const ROWS: usize, const N: usize> Vectorized for Padded<'_, T, ROWS, N> {
    #[inline(always)]
    fn run<const FMA: bool>(mut self) {
        let sum = &mut self.0;
        // Before the sums: rows lie far apart, and this short pass has many of them fetched at once.
        sum.count_active();
        let dof = sum.structure.pose_dof[sum.i] as usize;
        let mut normal = [[0.0f64; N]; N];
        let mut gradient = [0.0f64; N];
        for &o in sum.structure.observations_of(sum.i) {
            let row = &sum.linearization.rows[o as usize];
            if !row.is_active() {
                continue;
            }
            let params = sum.linearization.param_rows(o as usize, sum.size - dof);
            for k in 0..ROWS {
                let mut j = [0.0f64; N];
                let a = row.point[k];
                if dof == 6 {
                    let by_rotation = super::small::cross(&row.ray, &a);
                    (0..3).for_each(|c| j[c] = by_rotation[c].to_f64());
                }
                if dof >= 3 {
                    (0..3).for_each(|c| j[dof - 3 + c] = -a[c].to_f64());
                }
                if k < PIXELS {
                    for (slot, p) in j[dof..].iter_mut().zip(params[k]) {
                        *slot = p.to_f64();
                    }
                }
                let residual = row.residual[k].to_f64();
                for u in 0..N {
                    gradient[u] = if FMA { j[u].mul_add(residual, gradient[u]) } else { gradient[u] + j[u] * residual };
                    // The blocks of four that hold the upper triangle.
                    for v in u / 4 * 4..N {
                        normal[u][v] = if FMA { j[u].mul_add(j[v], normal[u][v]) } else { normal[u][v] + j[u] * j[v] };
                    }
                }
            }
        }
        let size = sum.size;
        sum.block.gradient.copy_from_slice(&gradient[..size]);
        for u in 0..size {
            for v in 0..size {
                sum.block.normal[u * size + v] = normal[u.min(v)][u.max(v)];
            }
        }
    }
}
