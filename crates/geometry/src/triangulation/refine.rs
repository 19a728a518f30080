//! Moves a point to the least sum of squared angular errors.

use glam::{DMat3, DVec3};

use super::View;

/// Gauss–Newton on the chord between bearing and direction (twice the sine of half the angular error): a few steps, each
/// kept only if the sum decreases. Returns the best point found, which is the start if no step helps.
pub fn refine_point(views: &[View], start: DVec3, max_iterations: usize) -> DVec3 {
    let mut position = start;
    let mut cost = cost_at(views, position);
    for _ in 0..max_iterations {
        let Some(step) = gauss_newton_step(views, position) else { break };
        let candidate = position + step;
        let candidate_cost = cost_at(views, candidate);
        let better = candidate_cost < cost;
        if !better {
            break;
        }
        // Further steps would move the sum by less than its own rounding.
        let settled = cost - candidate_cost <= 1e-12 * cost;
        (position, cost) = (candidate, candidate_cost);
        if settled {
            break;
        }
    }
    position
}

fn cost_at(views: &[View], position: DVec3) -> f64 {
    views
        .iter()
        .map(|v| match (position - v.center).try_normalize() {
            Some(direction) => (direction - v.ray_in_world).length_squared(),
            None => f64::INFINITY,
        })
        .sum()
}

fn gauss_newton_step(views: &[View], position: DVec3) -> Option<DVec3> {
    let (mut hessian, mut gradient) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let offset = position - view.center;
        let distance = offset.length();
        if distance <= 0.0 || !distance.is_finite() {
            return None;
        }
        let direction = offset / distance;
        // The direction's derivative, (I − d dᵀ)/distance, is symmetric and d is in its null space.
        let across = DMat3::IDENTITY
            - DMat3::from_cols(direction * direction.x, direction * direction.y, direction * direction.z);
        hessian += across * (1.0 / (distance * distance));
        gradient -= across * view.ray_in_world * (1.0 / distance);
    }
    let determinant = hessian.determinant();
    let scale = hessian.x_axis.x + hessian.y_axis.y + hessian.z_axis.z;
    // Singular: all directions are parallel, and the depth is free.
    let regular = determinant > 1e-15 * scale * scale * scale;
    let step = -(hessian.inverse() * gradient);
    (regular && step.is_finite()).then_some(step)
}
