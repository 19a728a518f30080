//! Matched pixels turned into what the estimators read: rays, their change per pixel, and blocks of them side by side.

use glam::{DVec2, DVec3};

use crate::camera::{Camera, project_with_derivatives};

/// A unit ray in its camera frame, with its derivative by the pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bearing {
    /// Unit ray.
    pub(super) ray: DVec3,
    /// ∂ray/∂(pixel x, pixel y), 1/px; both orthogonal to the ray.
    pub(super) by_pixel: [DVec3; 2],
    /// The rows of ∂pixel/∂ray, px.
    pub(super) pixel_by_ray: [DVec3; 2],
}

impl Bearing {
    /// `None` where the camera has no ray for the pixel or does not see along it.
    pub(super) fn from_pixel(camera: &Camera, pixel: DVec2) -> Option<Self> {
        if !pixel.is_finite() {
            return None;
        }
        let ray = camera.ray_from_pixel(pixel)?;
        let projection = project_with_derivatives(camera.model, &camera.params, ray.to_array())?;
        let [u, v] = projection.d_point.map(DVec3::from_array);
        Self::from_derivatives(ray, [u, v])
    }

    /// An image point `(x, y)` of an ideal camera of focal length `focal_px`: the ray of `(x, y, 1)`.
    pub(super) fn from_plane(point: DVec2, focal_px: f64) -> Option<Self> {
        let on_plane = point.extend(1.0);
        let length = on_plane.length();
        let rows = [DVec3::new(1.0, 0.0, -point.x), DVec3::new(0.0, 1.0, -point.y)];
        Self::from_derivatives(on_plane / length, rows.map(|row| row * (focal_px * length)))
    }

    fn from_derivatives(ray: DVec3, pixel_by_ray: [DVec3; 2]) -> Option<Self> {
        // The inverse of the 2 × 2 derivative within the plane that touches the sphere at the ray.
        let (a, b) = ray.any_orthonormal_pair();
        let [u, v] = pixel_by_ray;
        let (ua, ub, va, vb) = (u.dot(a), u.dot(b), v.dot(a), v.dot(b));
        let inverse = 1.0 / (ua * vb - ub * va);
        let by_pixel = [(a * vb - b * va) * inverse, (b * ua - a * ub) * inverse];
        let finite = by_pixel[0].is_finite() && by_pixel[1].is_finite() && u.is_finite() && v.is_finite();
        (finite && ray.is_finite()).then_some(Self { ray, by_pixel, pixel_by_ray })
    }
}

/// The two bearings of a match.
#[derive(Clone, Copy, Debug)]
pub(super) struct BearingPair {
    pub(super) first: Bearing,
    pub(super) second: Bearing,
}

/// Number of matches evaluated together: two AVX-512 or four AVX registers of doubles.
pub const LANES: usize = 8;

/// A vector for each lane, component by component, so that plain loops compile to vector instructions.
pub(super) type Lanes3 = [[f64; LANES]; 3];

/// The numbers of [`LANES`] items, `K` vectors each, laid out for vector instructions. Lanes past the end are zero.
#[derive(Clone, Debug)]
pub(super) struct Blocks<const K: usize> {
    blocks: Vec<[Lanes3; K]>,
    len: usize,
}

impl<const K: usize> Blocks<K> {
    pub(super) fn new(items: impl ExactSizeIterator<Item = [DVec3; K]>) -> Self {
        let len = items.len();
        let mut blocks = vec![[[[0.0; LANES]; 3]; K]; len.div_ceil(LANES)];
        for (i, vectors) in items.enumerate() {
            for (k, v) in vectors.iter().enumerate() {
                for c in 0..3 {
                    blocks[i / LANES][k][c][i % LANES] = v[c];
                }
            }
        }
        Self { blocks, len }
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    pub(super) fn block(&self, index: usize) -> &[Lanes3; K] {
        &self.blocks[index]
    }
}
