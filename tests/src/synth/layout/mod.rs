//! Where the points and the cameras of a scene are, one file per kind.

mod facade;
mod internet;
mod orbit;
mod street;

use epipole_geometry::Rigid3;
use glam::{DMat3, DQuat, DVec3};

use super::options::{Kind, Options};
use super::random::{Random, Stream};

/// A point of a surface.
pub(crate) struct WorldPoint {
    /// Metres.
    pub(crate) position: DVec3,
    /// Outward unit normal: the point shows only to cameras on its side.
    pub(crate) normal: DVec3,
    /// Colour, sRGB.
    pub(crate) rgb: [u8; 3],
    /// Factor on the probability of being detected, at most 1.
    pub(crate) popularity: f64,
}

/// The world before anyone photographs it.
pub(crate) struct Layout {
    /// One pose an image.
    pub(crate) cam_from_world: Vec<Rigid3>,
    /// For every image, its focal length relative to the typical one.
    pub(crate) zoom: Vec<f64>,
    /// The points.
    pub(crate) points: Vec<WorldPoint>,
    /// Points farther from a camera are not seen, metres.
    pub(crate) max_distance: f64,
}

pub(crate) fn build(options: &Options) -> Layout {
    let mut random = Random::new(options.seed, Stream::Layout);
    match options.kind {
        Kind::Orbit => orbit::build(options, &mut random),
        Kind::Street => street::build(options, &mut random),
        Kind::Facade => facade::build(options, &mut random),
        Kind::Internet => internet::build(options, &mut random),
    }
}

/// The pose of a camera at `center` that looks at `target`, turned about its axis by `roll_rad`; +Z is up.
fn look_at(center: DVec3, target: DVec3, roll_rad: f64) -> Rigid3 {
    let forward = (target - center).normalize_or(DVec3::X);
    let right = forward.cross(DVec3::Z).normalize_or(DVec3::X);
    let down = forward.cross(right);
    let cam_from_world = DQuat::from_mat3(&DMat3::from_cols(right, down, forward).transpose()).normalize();
    Rigid3::from_rotation_and_center(DQuat::from_rotation_z(roll_rad) * cam_from_world, center)
}

/// A colour for a point: the surface's, a little lighter or darker.
fn tint(random: &mut Random, base: [u8; 3]) -> [u8; 3] {
    let shade = random.uniform(0.6, 1.3);
    base.map(|channel| (f64::from(channel) * shade).min(255.0) as u8)
}
