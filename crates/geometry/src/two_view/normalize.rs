//! Conditioning of the linear solvers: coordinates of order one before any row is built.

use glam::{DMat3, DVec2, DVec3};

/// The similarity that moves the centroid to the origin and the mean distance from it to √2.
///
/// `None` where all points coincide or one is not finite. Source: Hartley, PAMI 1997.
pub(super) fn isotropic(points: &[DVec2]) -> Option<DMat3> {
    let n = points.len() as f64;
    let centroid = points.iter().sum::<DVec2>() / n;
    let distance = points.iter().map(|p| p.distance(centroid)).sum::<f64>() / n;
    let scale = std::f64::consts::SQRT_2 / distance;
    let shift = -centroid * scale;
    let t =
        DMat3::from_cols(DVec3::new(scale, 0.0, 0.0), DVec3::new(0.0, scale, 0.0), DVec3::new(shift.x, shift.y, 1.0));
    (t.is_finite() && distance > 1e-12 * (1.0 + centroid.length())).then_some(t)
}

/// The linear map that turns the second moment of the rays into the identity: Hartley's normalisation for directions,
/// which may also point sideways or backwards. `None` where the rays lie in one plane through the camera.
pub(super) fn whitening(rays: &[DVec3]) -> Option<DMat3> {
    let mut moment = nalgebra::Matrix3::<f64>::zeros();
    for r in rays {
        let v = nalgebra::Vector3::new(r.x, r.y, r.z);
        moment += v * v.transpose();
    }
    moment /= rays.len() as f64;
    let lower = moment.cholesky()?.l();
    if lower.diagonal().min() <= 1e-7 * lower.diagonal().max() {
        return None;
    }
    let inverse = lower.try_inverse()?;
    let t = DMat3::from_cols_slice(inverse.as_slice());
    t.is_finite().then_some(t)
}
