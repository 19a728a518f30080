//! The view graph of 1DSfM's Ellis Island, beside pycolmap 4.2.1 on the same edges.

use std::path::Path;
use std::sync::Arc;

use epipole_geometry::Rigid3;
use epipole_geometry::camera::{Camera, CameraModel};
use epipole_scene::{Pair, PairConfig, ViewGraph, ViewImage};
use glam::{DMat3, DQuat, DVec2, DVec3, DVec4};

use super::super::{Options, robust::rotation_vector, run};
use crate::event::Silent;

/// pycolmap 4.2.1, `run_rotation_averaging` with default options on these edges (two passes; seeds 0, 1 and 2 agree to
/// the digits shown): mean and median over 226 images of the angle after the chordal alignment, degrees.
const PYCOLMAP_DEG: (f64, f64) = (2.8957, 0.8299);

fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let numbers = |line: &str| line.split_whitespace().map(|x| x.parse().unwrap()).collect();
    text.lines().filter(|l| !l.starts_with('#')).map(numbers).collect()
}

fn rotation(row_major: &[f64]) -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols_slice(&row_major[..9]).transpose()).normalize()
}

fn view_graph(folder: &Path) -> ViewGraph {
    let rows = rows(&folder.join("edges.txt"));
    let pair = |r: &Vec<f64>| Pair {
        config: PairConfig::Calibrated,
        cam2_from_cam1: Some(Rigid3::new(rotation(&r[2..]), DVec3::X)),
        inliers: vec![[0, 0]; r.get(11).map_or(100, |&n| n as usize)],
        num_matches: 100,
        ..Pair::unverified(r[0] as usize, r[1] as usize)
    };
    let num_images = rows.iter().map(|r| r[0].max(r[1]) as usize + 1).max().unwrap();
    let image = |i: usize| ViewImage {
        id: i as u32 + 1,
        name: i.to_string(),
        camera: 0,
        keypoints_px: Arc::from([DVec2::ZERO]),
        depths: None,
    };
    ViewGraph {
        cameras: vec![Camera {
            id: 1,
            model: CameraModel::SimplePinhole,
            width_px: 100,
            height_px: 100,
            params: vec![100.0, 50.0, 50.0],
            has_prior_focal: true,
        }],
        images: (0..num_images).map(image).collect(),
        pairs: rows.iter().map(pair).collect(),
    }
}

/// Angles after the alignment of the worlds that minimises the chordal L2 distance, degrees, ascending.
fn aligned_errors_deg(pairs: &[(DQuat, DQuat)]) -> Vec<f64> {
    let world: Vec<DVec4> = pairs.iter().map(|(estimate, truth)| (estimate.conjugate() * *truth).into()).collect();
    // The largest eigenvector of Σ q qᵀ, by power iteration.
    let mut mean = world[0];
    for _ in 0..1000 {
        mean = world.iter().fold(DVec4::ZERO, |sum, &q| sum + q * q.dot(mean)).normalize();
    }
    let angle = |&q: &DVec4| rotation_vector(DQuat::from_vec4(q) * DQuat::from_vec4(mean).conjugate()).length();
    let mut errors: Vec<f64> = world.iter().map(|q| angle(q).to_degrees()).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

#[test]
fn no_worse_than_pycolmap() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/rotavg_ellis_island"));
    if !folder.exists() {
        println!("skipped: no shared data");
        return;
    }
    let graph = view_graph(folder);
    let found = epipole_optimize::executor::block_on(run(&graph, &Options::default(), &mut Silent)).unwrap();
    let component = &found.components[0];
    let truth = rows(&folder.join("gt.txt"));
    let truth_of = |image: usize| truth.iter().find(|r| r[0] as usize == image).map(|r| rotation(&r[1..]));
    let pairs: Vec<(DQuat, DQuat)> =
        component.images.iter().filter_map(|&(image, estimate)| Some((estimate, truth_of(image)?))).collect();
    let errors = aligned_errors_deg(&pairs);
    let (mean, median) = (errors.iter().sum::<f64>() / errors.len() as f64, errors[errors.len() / 2]);
    println!("{found}; mean {mean:.4}°, median {median:.4}° over {} images; pycolmap {PYCOLMAP_DEG:?}", errors.len());
    assert!(errors.len() >= 215 && mean <= PYCOLMAP_DEG.0 && median <= PYCOLMAP_DEG.1);
}
