//! The robust phases of rotation averaging: an L1 phase that forgives a bad start, Geman–McClure, and a tighter
//! Geman–McClure that is taken back where it opens a loop.

use glam::{DQuat, DVec3, DVec4};

use super::laplacian::Laplacian;
use super::{Edge, Options};
use crate::event::{Observer, breath};

/// Re-weightings inside one L1 round; COLMAP's ADMM starts with 10 inner iterations (algorithms.md §2.5).
const L1_INNER_ITERATIONS: usize = 10;

/// Residual at which an L1 weight stops growing, rad: a hundredth of a degree, far below the noise of any edge.
const L1_MIN_RESIDUAL_RAD: f64 = 1.7e-4;

/// The vector of a rotation: axis times angle in [0, π], rad.
pub(super) fn rotation_vector(rotation: DQuat) -> DVec3 {
    let q = if rotation.w < 0.0 { -rotation } else { rotation };
    let sine = q.xyz().length();
    // Near identity angle/sine tends to 2; the quotient below loses its digits first at 1e-150.
    if sine < 1e-100 { 2.0 * q.xyz() } else { q.xyz() * (2.0 * sine.atan2(q.w) / sine) }
}

/// `log(R_jᵀ R_ij R_i)` of every edge: what is left over, in the world frame, rad.
pub(super) fn residuals(edges: &[Edge], rotations: &[DQuat]) -> Vec<DVec3> {
    let of = |e: &Edge| rotation_vector(rotations[e.j].conjugate() * e.j_from_i * rotations[e.i]);
    edges.iter().map(of).collect()
}

/// Geman–McClure weight of a residual, 1 at zero.
pub(super) fn geman_mcclure(residual_rad: f64, sigma_rad: f64) -> f64 {
    (1.0 + (residual_rad / sigma_rad).powi(2)).powi(-2)
}

/// Improves the rotations of a connected graph in place; `prior` weights the edges in every step.
pub(super) async fn refine(
    edges: &[Edge],
    prior: &[f64],
    rotations: &mut [DQuat],
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<(), String> {
    let ends: Vec<[usize; 2]> = edges.iter().map(|e| [e.i, e.j]).collect();
    let mut laplacian = Laplacian::new(rotations.len(), &ends)?;
    for _ in 0..options.max_l1_rounds {
        let residuals = residuals(edges, rotations);
        let step = l1_step(&mut laplacian, &ends, prior, &residuals, observer).await?;
        if apply(rotations, &step) < options.l1_step_tolerance_rad {
            break;
        }
    }
    geman_mcclure_phase(&mut laplacian, edges, prior, rotations, options.irls_sigma_deg, options, observer).await?;
    if options.final_sigma_deg > 0.0 {
        let mut polished = rotations.to_vec();
        let sigma_deg = options.final_sigma_deg;
        geman_mcclure_phase(&mut laplacian, edges, prior, &mut polished, sigma_deg, options, observer).await?;
        let noise = median(residuals(edges, rotations).iter().map(|r| r.length()).collect());
        if median_change(rotations, &polished) <= noise {
            rotations.copy_from_slice(&polished);
        }
    }
    Ok(())
}

async fn geman_mcclure_phase(
    laplacian: &mut Laplacian,
    edges: &[Edge],
    prior: &[f64],
    rotations: &mut [DQuat],
    sigma_deg: f64,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<(), String> {
    for _ in 0..options.max_irls_rounds {
        let residuals = residuals(edges, rotations);
        let weight = |(r, p): (&DVec3, &f64)| p * geman_mcclure(r.length(), sigma_deg.to_radians());
        let weights: Vec<f64> = residuals.iter().zip(prior).map(weight).collect();
        let step = laplacian.solve(&weights, &residuals)?;
        breath(observer).await;
        if apply(rotations, &step) < options.irls_step_tolerance_rad {
            break;
        }
    }
    Ok(())
}

/// Median angle between two sets of rotations after their worlds are aligned, rad.
fn median_change(before: &[DQuat], after: &[DQuat]) -> f64 {
    let world: Vec<DQuat> = before.iter().zip(after).map(|(b, a)| b.conjugate() * *a).collect();
    let sum = world.iter().fold(DVec4::ZERO, |sum, &w| {
        let w = DVec4::from(w);
        sum + if w.dot(world[0].into()) < 0.0 { -w } else { w }
    });
    let mean = DQuat::from_vec4(sum.normalize_or(DVec4::W));
    median(world.iter().map(|w| rotation_vector(mean.conjugate() * *w).length()).collect())
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The minimiser of `Σ prior ‖θ_j − θ_i − r_ij‖` by re-weighted least squares.
async fn l1_step(
    laplacian: &mut Laplacian,
    ends: &[[usize; 2]],
    prior: &[f64],
    residuals: &[DVec3],
    observer: &mut dyn Observer,
) -> Result<Vec<DVec3>, String> {
    let mut step = vec![DVec3::ZERO; laplacian.num_vertices()];
    for _ in 0..L1_INNER_ITERATIONS {
        let left = |(&[i, j], r): (&[usize; 2], &DVec3)| (*r - (step[j] - step[i])).length();
        let left = ends.iter().zip(residuals).map(left);
        let weights: Vec<f64> = left.zip(prior).map(|(e, p)| p / e.max(L1_MIN_RESIDUAL_RAD)).collect();
        step = laplacian.solve(&weights, residuals)?;
        breath(observer).await;
    }
    Ok(step)
}

/// Turns every rotation by its step in the world frame; the mean length of the steps, rad.
fn apply(rotations: &mut [DQuat], step: &[DVec3]) -> f64 {
    for (rotation, &theta) in rotations.iter_mut().zip(step) {
        *rotation = (*rotation * DQuat::from_scaled_axis(theta)).normalize();
    }
    step.iter().map(|s| s.length()).sum::<f64>() / step.len() as f64
}
