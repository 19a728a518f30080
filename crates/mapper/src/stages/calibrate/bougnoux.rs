//! Focal lengths of one pair from its fundamental matrix, in closed form.

use glam::{DMat3, DVec2, DVec3};

/// Squared focal lengths of image 1 and image 2, px², from `x2ᵀ F x1 = 0` and the principal points; negative or not
/// finite where the motion leaves them open (optical axes that meet, pure rotation) or the matrix is too noisy.
///
/// Bougnoux, "From projective to Euclidean space under any practical situation", ICCV 1998:
/// `f1² = −(pᵀ [e2]ₓ Ĩ G p)(pᵀ Gᵀ p) / (pᵀ [e2]ₓ Ĩ G Ĩ Gᵀ p)` with principal points moved to the origin, `p = (0, 0, 1)`,
/// `Ĩ = diag(1, 1, 0)` and `e2` the epipole in image 2. It is what the residuals of Fetzer et al. (algorithms.md §2.4)
/// come to at focal lengths of more than a few pixels, where their two equations no longer depend on one another.
pub(super) fn squared_focals(fundamental: &DMat3, principal1_px: DVec2, principal2_px: DVec2) -> [f64; 2] {
    let to_origin = |c: DVec2| DMat3::from_cols(DVec3::X, DVec3::Y, c.extend(1.0));
    let centred = to_origin(principal2_px).transpose() * *fundamental * to_origin(principal1_px);
    [squared_focal_of_first(&centred), squared_focal_of_first(&centred.transpose())]
}

fn squared_focal_of_first(g: &DMat3) -> f64 {
    let epipole = left_null_vector(g);
    let flat = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0));
    // pᵀ [e2]ₓ = (−e_y, e_x, 0).
    let row = DVec3::new(-epipole.y, epipole.x, 0.0);
    let numerator = row.dot(flat * g.z_axis) * g.z_axis.z;
    let denominator = row.dot(flat * (*g * (flat * g.transpose().z_axis)));
    -numerator / denominator
}

/// The direction orthogonal to the columns of a matrix of rank two: their longest cross product.
fn left_null_vector(g: &DMat3) -> DVec3 {
    let [a, b, c] = [g.x_axis, g.y_axis, g.z_axis].map(DVec3::normalize_or_zero);
    let longest = |x: DVec3, y: DVec3| if y.length_squared() > x.length_squared() { y } else { x };
    longest(longest(a.cross(b), a.cross(c)), b.cross(c)).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn exact_matrices_give_exact_focals() {
        let k = |f: f64, c: DVec2| DMat3::from_cols(DVec3::new(f, 0.0, 0.0), DVec3::new(0.0, f, 0.0), c.extend(1.0));
        let (c1, c2) = (DVec2::new(400.0, 260.0), DVec2::new(1000.0, 700.0));
        let (k1, k2) = (k(827.0, c1), k(1500.0, c2));
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.1)));
        let t = DVec3::new(1.0, 0.2, 0.4);
        let cross =
            DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0));
        let f = k2.inverse().transpose() * cross * rotation * k1.inverse();
        let [f1, f2] = squared_focals(&(f * 7.0), c1, c2);
        assert!((f1.sqrt() - 827.0).abs() < 1e-5 && (f2.sqrt() - 1500.0).abs() < 1e-5, "{f1} {f2}");
    }
}
