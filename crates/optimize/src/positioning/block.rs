//! One linearised observation, and the ways a residual becomes one.

use epipole_geometry::camera::Real;

use super::triangle::{Triangle, fold_projector};
use super::vec3::{Vec3, dot, scale, sub, zero};
use crate::loss::Loss;

/// The quadratic model of one observation in the step difference `e = δX − δC`: `½ eᵀ M e + gradientᵀ e` with
/// `M = scale² (I − direction directionᵀ)`.
///
/// `direction` is a unit vector where the observation's own scale is eliminated (nothing is known along the ray), and
/// zero where the scale is held, which leaves `M = scale² I`. `scale = 0` masks the observation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block<T> {
    /// Unit vector along which the observation says nothing, or zero.
    pub(crate) direction: Vec3<T>,
    /// Square root of the weight times the ray's scale `s`.
    pub(crate) scale: T,
    /// Gradient of the cost in `e`.
    pub(crate) gradient: Vec3<T>,
}

impl<T: Real> Block<T> {
    /// An observation that takes no part.
    pub(crate) fn masked() -> Self {
        Self { direction: zero(), scale: T::ZERO, gradient: zero() }
    }

    /// `M e`.
    #[inline(always)]
    pub(crate) fn apply(&self, e: Vec3<T>) -> Vec3<T> {
        let across = sub(e, scale(self.direction, dot(self.direction, e)));
        scale(across, self.scale * self.scale)
    }

    /// `√M e`, so that `‖√M e‖² = eᵀ M e`.
    #[inline(always)]
    pub(crate) fn apply_root(&self, e: Vec3<T>) -> Vec3<T> {
        scale(sub(e, scale(self.direction, dot(self.direction, e))), self.scale)
    }

    /// Adds the observation to its point's triangle.
    #[inline]
    pub(crate) fn fold_into(&self, triangle: &mut Triangle<T>) {
        fold_projector(triangle, self.scale, self.direction);
    }
}

/// ρ and the weight ρ′ of a squared residual.
#[inline(always)]
fn evaluate<T: Real>(loss: Loss, square: T) -> (T, T) {
    let square = square.to_f64();
    (T::from_f64(loss.value(square)), T::from_f64(loss.weight(square)))
}

/// What the residual `v − s d` of one observation is worth and how it is linearised.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Model<T> {
    /// Loss of observations with a free scale.
    pub(crate) free_loss: Loss,
    /// Loss of observations with a pinned scale.
    pub(crate) pinned_loss: Loss,
    /// Least scale; a point behind its camera has this one.
    pub(crate) min_scale: T,
}

impl<T: Real> Model<T> {
    /// The best scale `max(s_min, vᵀd / ‖d‖²)` of a free observation; `None` when the bound holds it.
    #[inline(always)]
    fn best_scale(&self, ray: Vec3<T>, d: Vec3<T>) -> Option<T> {
        let s = dot(ray, d) / dot(d, d);
        // False for NaN too (a point on its camera).
        if s > self.min_scale { Some(s) } else { None }
    }

    /// `ω ρ(‖v − s d‖²)` with the scale re-solved exactly, and whether the observation pulls (is not at the bound).
    #[inline(always)]
    pub(crate) fn cost(&self, ray: Vec3<T>, weight: T, pin: T, d: Vec3<T>) -> (T, bool) {
        let (s, loss, pulls) = if pin > T::ZERO {
            (pin, self.pinned_loss, true)
        } else {
            match self.best_scale(ray, d) {
                Some(s) => (s, self.free_loss, true),
                None => (self.min_scale, self.free_loss, false),
            }
        };
        let u = sub(ray, scale(d, s));
        (weight * T::from_f64(loss.value(dot(u, u).to_f64())), pulls)
    }

    /// The linearised observation with the scale eliminated (variable projection, Kaufman's form), and its cost `ω ρ`.
    /// A free observation at the bound has no gradient worth following and is masked.
    #[inline(always)]
    pub(crate) fn linearize(&self, ray: Vec3<T>, weight: T, pin: T, d: Vec3<T>) -> (Block<T>, T) {
        if pin > T::ZERO {
            return held(ray, weight, pin, d, self.pinned_loss);
        }
        match self.best_scale(ray, d) {
            None => (Block::masked(), self.cost(ray, weight, pin, d).0),
            Some(s) => {
                let (mut block, cost) = held(ray, weight, s, d, self.free_loss);
                block.direction = scale(d, T::ONE / dot(d, d).sqrt());
                (block, cost)
            }
        }
    }
}

/// The linearised observation with the scale held at `s`, and its cost `ω ρ`.
#[inline(always)]
pub(crate) fn held<T: Real>(ray: Vec3<T>, weight: T, s: T, d: Vec3<T>, loss: Loss) -> (Block<T>, T) {
    let u = sub(ray, scale(d, s));
    let (rho, robust) = evaluate(loss, dot(u, u));
    let w = weight * robust;
    (Block { direction: zero(), scale: w.sqrt() * s, gradient: scale(u, -(w * s)) }, weight * rho)
}

/// The reweighted observation of least unsquared deviations, `ω ‖d − ℓ v‖` with the best length `ℓ = max(bound, vᵀd)`
/// of a free ray, and its cost. A length at the bound is held.
#[inline(always)]
pub(crate) fn deviation<T: Real>(ray: Vec3<T>, weight: T, pin: T, d: Vec3<T>, bound: T, delta: T) -> (Block<T>, T) {
    let along = dot(ray, d);
    let (length, free) = if pin > T::ZERO {
        (T::ONE / pin, false)
    } else if along > bound {
        (along, true)
    } else {
        (bound, false)
    };
    let r = sub(d, scale(ray, length));
    let deviation = dot(r, r).sqrt();
    let w = weight / deviation.max(delta);
    let direction = if free { ray } else { zero() };
    (Block { direction, scale: w.sqrt(), gradient: scale(r, w) }, weight * deviation)
}
