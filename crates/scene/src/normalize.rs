//! Moves and scales a reconstruction so that its numbers are of order one, whatever the unknown scale came out as.

use epipole_geometry::Similarity3;
use glam::{DQuat, DVec3};

use crate::Reconstruction;

/// The diagonal of the box of camera centres after normalisation (source: `algorithms.md` §2.11).
pub const NORMALIZED_EXTENT: f64 = 10.0;

/// This fraction of the coordinates is left out at either end (source: `algorithms.md` §2.11).
const TRIMMED_FRACTION: f64 = 0.1;

/// The similarity that puts the trimmed mean of the camera centres at the origin and gives the box between their 10th and
/// 90th percentiles a diagonal of [`NORMALIZED_EXTENT`]. The axes keep their directions.
///
/// Percentiles as COLMAP takes them: of `n` sorted values those from `⌊0.1 (n − 1)⌋` to as far from the end. The scale is 1
/// if the box is a point; `None` if there is no centre or a number is not finite.
pub fn normalizing_similarity(centers: &[DVec3]) -> Option<Similarity3> {
    let n = centers.len();
    if n == 0 || centers.iter().any(|c| !c.is_finite()) {
        return None;
    }
    let first = (TRIMMED_FRACTION * (n - 1) as f64) as usize;
    let last = n - 1 - first;
    let (mut lower, mut upper, mut mean) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for axis in 0..3 {
        let mut values: Vec<f64> = centers.iter().map(|c| c[axis]).collect();
        values.sort_by(f64::total_cmp);
        lower[axis] = values[first];
        upper[axis] = values[last];
        mean[axis] = values[first..=last].iter().sum::<f64>() / (last - first + 1) as f64;
    }
    let diagonal = (upper - lower).length();
    let scale = if diagonal > f64::EPSILON { NORMALIZED_EXTENT / diagonal } else { 1.0 };
    Some(Similarity3 { scale, rotation: DQuat::IDENTITY, translation: -scale * mean })
}

/// Normalises a reconstruction by its camera centres and returns the motion applied, `new_from_old`; a reconstruction
/// without images, or with a broken pose, stays as it is.
pub fn normalize(reconstruction: &mut Reconstruction) -> Similarity3 {
    let centers: Vec<DVec3> = reconstruction.images.iter().map(|i| i.cam_from_world.center()).collect();
    let new_from_old = normalizing_similarity(&centers).unwrap_or(Similarity3::IDENTITY);
    reconstruction.transform(&new_from_old);
    new_from_old
}

/// Moves the trimmed mean of the camera centres to the origin as [`normalize`] does, and keeps the scale. Returns the motion
/// applied, `new_from_old`.
pub fn center(reconstruction: &mut Reconstruction) -> Similarity3 {
    let centers: Vec<DVec3> = reconstruction.images.iter().map(|i| i.cam_from_world.center()).collect();
    let new_from_old = normalizing_similarity(&centers).map_or(Similarity3::IDENTITY, |motion| Similarity3 {
        scale: 1.0,
        rotation: DQuat::IDENTITY,
        translation: motion.translation / motion.scale,
    });
    reconstruction.transform(&new_from_old);
    new_from_old
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_trimmed_box_has_the_extent_and_the_trimmed_mean_is_the_origin() {
        // 21 centres on the diagonal of a cube; two at either end are trimmed.
        let mut centers: Vec<_> = (0..21).map(|i| DVec3::splat(i as f64)).collect();
        centers[0] = DVec3::splat(-1e6);
        centers[20] = DVec3::splat(1e9);
        let motion = normalizing_similarity(&centers).expect("finite");
        let expected = 10.0 / (16.0 * 3f64.sqrt());
        assert!((motion.scale - expected).abs() < 1e-12);
        assert!(motion.transform_point(DVec3::splat(10.0)).length() < 1e-12);
        assert!((motion.transform_point(DVec3::splat(18.0)).length() - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_point_keeps_its_scale_and_nothing_stays_nothing() {
        let motion = normalizing_similarity(&[DVec3::ONE; 4]).expect("finite");
        assert_eq!(motion, Similarity3 { scale: 1.0, rotation: DQuat::IDENTITY, translation: -DVec3::ONE });
        assert_eq!(normalizing_similarity(&[]), None);
        assert_eq!(normalizing_similarity(&[DVec3::NAN]), None);
        assert_eq!(normalize(&mut Reconstruction::default()), Similarity3::IDENTITY);
    }
}
