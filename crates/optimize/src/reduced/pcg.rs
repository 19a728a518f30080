//! Preconditioned conjugate gradients with the stop that suits an inexact Newton step.

use crate::lm::{Observer, breath};

/// A symmetric positive definite operator.
pub trait LinearOperator {
    /// `out = A x`; returns `xᵀ A x`, which an operator that is a sum of squares can give without cancellation.
    fn apply(&mut self, x: &[f64], out: &mut [f64]) -> f64;
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgOptions {
    /// Stop when the last iteration improved the quadratic model by less than this share of its mean improvement
    /// (Nash and Sofer's test, as in Ceres; source: `solver.md` §5.2).
    pub eta: f64,
    /// At least this many iterations.
    pub min_iterations: usize,
    /// At most this many iterations.
    pub max_iterations: usize,
}

impl Default for PcgOptions {
    fn default() -> Self {
        Self { eta: 0.1, min_iterations: 3, max_iterations: 100 }
    }
}

/// What came out.
#[derive(Clone, Debug)]
pub struct PcgResult {
    /// The approximate solution.
    pub x: Vec<f64>,
    /// Applications of the operator.
    pub iterations: usize,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Approximates `A x = rhs` from `x = 0`. `precondition(r, z)` sets `z ≈ A⁻¹ r`. Ends early where the observer asks to stop.
pub async fn pcg(
    operator: &mut impl LinearOperator,
    mut precondition: impl FnMut(&[f64], &mut [f64]),
    rhs: &[f64],
    options: &PcgOptions,
    observer: &mut dyn Observer,
) -> PcgResult {
    let n = rhs.len();
    let mut x = vec![0.0; n];
    let mut residual = rhs.to_vec();
    let (mut z, mut product) = (vec![0.0; n], vec![0.0; n]);
    precondition(&residual, &mut z);
    let mut direction = z.clone();
    let mut rz = dot(&residual, &z);
    let mut model = 0.0;
    let mut iterations = 0;
    while iterations < options.max_iterations && rz > 0.0 {
        breath(observer).await;
        if observer.should_stop() {
            break;
        }
        iterations += 1;
        let curvature = operator.apply(&direction, &mut product);
        // Not positive: rounding has used up the direction; what is found so far still lowers the model.
        if curvature <= 0.0 || !curvature.is_finite() {
            break;
        }
        let step = rz / curvature;
        for k in 0..n {
            x[k] += step * direction[k];
            residual[k] -= step * product[k];
        }
        // Twice the decrease of the quadratic model so far: xᵀ(rhs + residual).
        let improved: f64 = (0..n).map(|k| x[k] * (rhs[k] + residual[k])).sum();
        let slow = iterations as f64 * (improved - model) < options.eta * improved;
        model = improved;
        if iterations >= options.min_iterations && slow {
            break;
        }
        precondition(&residual, &mut z);
        let next = dot(&residual, &z);
        let beta = next / rz;
        rz = next;
        for k in 0..n {
            direction[k] = z[k] + beta * direction[k];
        }
    }
    PcgResult { x, iterations }
}
