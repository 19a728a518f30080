//! Points out of the way at one damping: their damped blocks, and their factors for the reduced matrix.

use epipole_geometry::camera::Real;

use super::linearization::Linearization;
use super::point_block::{Triangle, damp, solve_row};
use super::small::{Vec3, to_f64};
use super::structure::Structure;
use crate::lm::Observer;
use crate::parallel;
use crate::reduced::BlockMatrix;

/// Points that one thread damps at a time.
const GROUP: usize = 2048;

/// A damped point.
#[derive(Clone, Copy, Debug)]
pub(super) struct DampedPoint {
    /// R̃, with reciprocals on the diagonal; all zero where the point is frozen, which makes every solve give 0.
    pub(super) triangle: Triangle<f64>,
    /// `R̃⁻ᵀ J_pᵀ r`.
    pub(super) gradient: Vec3<f64>,
}

/// All points at one damping.
pub(super) fn damp_points<T: Real, const ROWS: usize>(
    linearization: &Linearization<T, ROWS>,
    lambda: f64,
    out: &mut Vec<DampedPoint>,
) {
    let root = lambda.sqrt();
    let empty = DampedPoint { triangle: [0.0; 6], gradient: [0.0; 3] };
    out.clear();
    out.resize(linearization.points.len(), empty);
    let mut pieces: Vec<_> = out.chunks_mut(GROUP).zip(linearization.points.chunks(GROUP)).collect();
    parallel::for_each_mut(&mut pieces, |_, (out, blocks)| {
        for (out, block) in out.iter_mut().zip(blocks.iter()) {
            if block.free {
                out.triangle = damp(&block.triangle, root);
                out.gradient = solve_row(&out.triangle, &block.gradient);
            }
        }
    });
}

/// `matrix −= Σ_points E Eᵀ`, `rhs += Σ_points E R̃⁻ᵀ J_pᵀ r`.
pub(super) async fn subtract_points<T: Real, const ROWS: usize>(
    structure: &Structure,
    linearization: &Linearization<T, ROWS>,
    damped: &[DampedPoint],
    matrix: &mut BlockMatrix,
    rhs: &mut [f64],
    observer: &mut dyn Observer,
) {
    if structure.fixed_points {
        return;
    }
    let fill = |p: usize, factors: &mut [f64]| point_factors(structure, linearization, &damped[p], p, factors);
    matrix.eliminate_points(&structure.incidence, fill, |p| damped[p].gradient, rhs, observer).await;
}

/// `Eᵀ` of every participant of a point, into zeroed memory.
pub(super) fn point_factors<T: Real, const ROWS: usize>(
    structure: &Structure,
    linearization: &Linearization<T, ROWS>,
    damped: &DampedPoint,
    p: usize,
    factors: &mut [f64],
) {
    if !linearization.points[p].free {
        return;
    }
    let pitch = structure.layout.factor_stride();
    let blocks = structure.incidence.blocks(p);
    let mut participant = 0;
    for o in structure.track(p) {
        let i = structure.image[o] as usize;
        let row = &linearization.rows[o];
        let z = row.point.map(|row| solve_row(&damped.triangle, &to_f64(row)));
        let dof = structure.pose_dof[i] as usize;
        if structure.layout.size(i) > 0 {
            // Tracks are sorted by image and so are the blocks of a point.
            while blocks[participant] != i as u32 {
                participant += 1;
            }
            if dof > 0 {
                let out = &mut factors[participant * 3 * pitch..(participant + 1) * 3 * pitch];
                add_pose(linearization, o, &z, dof, pitch, out);
            }
        }
        let c = structure.camera[i] as usize;
        let count = structure.free_params[c].len();
        if count > 0 {
            let slot = structure.param_slot[c];
            let at = if slot.block == i {
                Some(participant)
            } else {
                blocks.iter().rposition(|&b| b as usize == slot.block)
            };
            let Some(at) = at else { continue };
            let [a, b] = linearization.param_rows(o, count);
            for k in 0..3 {
                let line = &mut factors[(at * 3 + k) * pitch + slot.offset..][..count];
                for (n, value) in line.iter_mut().enumerate() {
                    *value += a[n].to_f64() * z[0][k] + b[n].to_f64() * z[1][k];
                }
            }
        }
    }
}

#[inline(always)]
fn add_pose<T: Real, const ROWS: usize>(
    linearization: &Linearization<T, ROWS>,
    o: usize,
    z: &[Vec3<f64>; ROWS],
    dof: usize,
    pitch: usize,
    out: &mut [f64],
) {
    for k in 0..3 {
        let (rotation, center) = linearization.pose_transposed(o, std::array::from_fn(|row| z[row][k]));
        let line = &mut out[k * pitch..][..dof];
        if dof == 6 {
            (0..3).for_each(|n| line[n] += rotation[n]);
        }
        (0..3).for_each(|n| line[dof - 3 + n] += center[n]);
    }
}
