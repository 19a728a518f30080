//! A point from two or more views by linear least squares.

use glam::{DMat3, DVec3};

use super::View;
use super::eigen::smallest_eigenvector;

/// The smallest eigenvector of `Σ (P − b bᵀP)ᵀ(P − b bᵀP)` over the views (source: `algorithms.md` §2.10), where `P` is
/// cam_from_world and `b` the bearing: the point whose distances from all rays are least.
///
/// The sum is formed in a frame with its origin at the mean camera centre and the centres' spread as its unit, which
/// makes the result independent of the frame and the scale of the world. `None` for fewer than two views, for equal
/// centres, or a point at infinity. The point may lie behind.
pub fn triangulate_multi_view(views: &[View]) -> Option<DVec3> {
    triangulate_selected(views, |_| true)
}

/// The same from the views that `selected` accepts by index.
pub(super) fn triangulate_selected(views: &[View], selected: impl Fn(usize) -> bool) -> Option<DVec3> {
    let chosen = || views.iter().enumerate().filter(|(i, _)| selected(*i)).map(|(_, v)| v);
    let (mut origin, mut count) = (DVec3::ZERO, 0usize);
    for view in chosen() {
        origin += view.center;
        count += 1;
    }
    if count < 2 {
        return None;
    }
    origin /= count as f64;
    let spread2 = chosen().map(|v| v.center.distance_squared(origin)).sum::<f64>() / count as f64;
    let unit = spread2.sqrt();
    if !(unit > 0.0 && unit.is_finite()) {
        return None;
    }
    // (P − b bᵀP)ᵀ(P − b bᵀP) = [Q, −Qc; −cᵀQ, cᵀQc] with Q = I − d dᵀ, d the bearing in the world and c the centre.
    let mut normal = [[0.0; 4]; 4];
    for view in chosen() {
        let d = view.ray_in_world;
        let c = (view.center - origin) / unit;
        let qc = c - d * d.dot(c);
        let q = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        for i in 0..3 {
            for j in 0..=i {
                normal[i][j] += q.col(j)[i];
            }
            normal[3][i] -= qc[i];
        }
        normal[3][3] += c.dot(qc);
    }
    let [x, y, z, w] = smallest_eigenvector(normal)?;
    let position = origin + unit * (DVec3::new(x, y, z) / w);
    position.is_finite().then_some(position)
}
