//! A long street: every point is seen by consecutive images, so that points in the street's order have their images in
//! common with their neighbours, and points in a shuffled order with nobody.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Observations by point.
pub(crate) const TRACK: usize = 5;
/// Observations of an image that one workgroup sums, as in the product.
const SEGMENT: usize = 512;
/// Observations of an image: a few workgroups.
const PER_IMAGE: usize = 2000;

/// Arrays as `operator.wgsl` wants them.
pub(crate) struct Street {
    pub(crate) cameras: Vec<[f32; 32]>,
    pub(crate) points: Vec<[f32; 8]>,
    pub(crate) tracks: Vec<u32>,
    pub(crate) by_point: Vec<[u32; 2]>,
    pub(crate) by_image: Vec<[u32; 2]>,
    pub(crate) segments: Vec<[u32; 4]>,
}

impl Street {
    pub(crate) fn new(observations: usize, shuffled: bool) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let points = observations / TRACK;
        let images = (observations / PER_IMAGE).max(2 * TRACK);
        let mut order: Vec<usize> = (0..points).collect();
        if shuffled {
            order.shuffle(&mut random);
        }
        let mut street = Self {
            cameras: Vec::new(),
            points: Vec::new(),
            tracks: vec![0],
            by_point: Vec::new(),
            by_image: Vec::new(),
            segments: Vec::new(),
        };
        for i in 0..images {
            let mut camera = [0.0; 32];
            // Looks sideways; f, k1, k2; a direction.
            camera[..16].copy_from_slice(&[
                1.0, 0.0, 0.0, i as f32, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, -8.0, 900.0, -0.05, 0.01, 0.0,
            ]);
            for value in &mut camera[16..28] {
                *value = random.random_range(-1e-3..1e-3);
            }
            street.cameras.push(camera);
        }
        let weight = 1f32.to_bits();
        let mut seen_by = vec![Vec::new(); images];
        for (p, &place) in order.iter().enumerate() {
            let first = (place as f64 / points as f64 * (images - TRACK) as f64) as usize;
            let x = first as f32 + 0.5 * TRACK as f32 + random.random_range(-1.0f32..1.0);
            street.points.push([
                x,
                random.random_range(-2.0..2.0),
                random.random_range(-1.0..1.0),
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            ]);
            for (image, seen) in (first..first + TRACK).zip(&mut seen_by[first..]) {
                street.by_point.push([image as u32, weight]);
                seen.push(p as u32);
            }
            street.tracks.push(street.by_point.len() as u32);
        }
        for (image, seen) in seen_by.iter().enumerate() {
            let start = street.by_image.len();
            street.by_image.extend(seen.iter().map(|&p| [p, weight]));
            for from in (start..street.by_image.len()).step_by(SEGMENT) {
                let end = street.by_image.len().min(from + SEGMENT);
                street.segments.push([image as u32, from as u32, end as u32, 0]);
            }
        }
        street
    }
}
