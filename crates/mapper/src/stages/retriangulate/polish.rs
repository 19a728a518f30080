//! Moves points, and points only, to a smaller reprojection error: cheaper than bundle adjustment by the whole of its
//! camera part, and enough after tracks have grown.

use glam::{DMat3, DVec3};

use super::cluster::Cluster;

/// Steps that would move the projections by less than this end the iteration, px: a hundredth of the noise of a keypoint.
const SETTLED_PX: f64 = 1e-2;

/// Gauss–Newton on the Huber cost of one point's reprojection errors, at most `steps`; a step that does not lower the
/// cost is not taken.
pub(super) fn polish(cluster: &mut Cluster<'_>, point: usize, huber_px: f64, steps: usize) {
    let draft = cluster.point(point);
    let mut position = draft.position;
    let Some(mut at) = linearize(cluster, &draft.slots, position, huber_px) else { return };
    for _ in 0..steps {
        let scale = at.hessian.x_axis.x + at.hessian.y_axis.y + at.hessian.z_axis.z;
        // Parallel rays leave the depth free; bundle adjustment would not move it either.
        let conditioned = at.hessian.determinant() > 1e-12 * scale.powi(3);
        if !conditioned {
            break;
        }
        let step = -(at.hessian.inverse() * at.gradient);
        let Some(next) = linearize(cluster, &draft.slots, position + step, huber_px) else { break };
        let better = next.cost < at.cost;
        if !better {
            break;
        }
        position += step;
        let moved_px2 = step.dot(at.hessian * step) / draft.slots.len() as f64;
        at = next;
        if moved_px2 < SETTLED_PX * SETTLED_PX {
            break;
        }
    }
    cluster.set_position(point, position);
}

struct Linearized {
    cost: f64,
    hessian: DMat3,
    gradient: DVec3,
}

/// `None` where the point does not project into one of its images.
fn linearize(cluster: &Cluster<'_>, slots: &[u32], position: DVec3, huber_px: f64) -> Option<Linearized> {
    let mut sum = Linearized { cost: 0.0, hessian: DMat3::ZERO, gradient: DVec3::ZERO };
    for &slot in slots {
        let e = cluster.views.linear_error(slot, position)?;
        let error_px = e.error_px.length();
        let weight = if error_px <= huber_px { 1.0 } else { huber_px / error_px };
        sum.cost +=
            if error_px <= huber_px { 0.5 * error_px * error_px } else { huber_px * (error_px - 0.5 * huber_px) };
        for (row, residual) in e.rows.into_iter().zip(e.error_px.to_array()) {
            sum.hessian += weight * DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            sum.gradient += weight * residual * row;
        }
    }
    Some(sum)
}
