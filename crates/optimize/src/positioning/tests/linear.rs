//! The step against the textbook: derivatives by differences, elimination against the full system.

use super::scene::{Kind, Noise, Random, scene};
use crate::executor::block_on;
use crate::loss::Loss;
use crate::positioning::block::{Block, Model};
use crate::positioning::layout::Layout;
use crate::positioning::normal::{LinearSolver, Normal, Shape};
use crate::positioning::triangle::floored;

#[test]
fn the_gradient_is_the_slope_of_the_cost() {
    let mut random = Random(3);
    let model = Model { free_loss: Loss::Huber(0.01), pinned_loss: Loss::Huber(0.1), min_scale: 1e-5 };
    for k in 0..300 {
        let d = (random.normals() * 3.0).to_array();
        let near = (glam::DVec3::from(d).normalize() + 0.02 * random.normals()).normalize();
        let ray = if k % 3 == 0 { random.normals().normalize() } else { near }.to_array();
        let pin = if k % 2 == 0 { 0.0 } else { random.uniform(0.1, 1.0) };
        let (block, _) = model.linearize(ray, 0.5, pin, d);
        for axis in 0..3 {
            let h = 1e-6;
            let cost = |sign: f64| {
                let mut moved = d;
                moved[axis] += sign * h;
                0.5 * model.cost(ray, 0.5, pin, moved).0
            };
            let slope = (cost(1.0) - cost(-1.0)) / (2.0 * h);
            let error = (slope - block.gradient[axis]).abs();
            // At the bound the slope is of the size of the bound, and the observation is masked.
            assert!(error < 1e-7 + 3e-5 * f64::from(u8::from(block.scale == 0.0)), "{k} {slope} {:?}", block.gradient);
        }
    }
}

/// Solves a dense system by elimination with pivoting.
fn dense_solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..n {
            let f = a[i][k] / a[k][k];
            for j in k..n {
                a[i][j] -= f * a[k][j];
            }
            b[i] -= f * b[k];
        }
    }
    for k in (0..n).rev() {
        b[k] = (b[k] - (k + 1..n).map(|j| a[k][j] * b[j]).sum::<f64>()) / a[k][k];
    }
    b
}

#[test]
fn elimination_gives_the_step_of_the_full_system() {
    let mut problem = scene(Kind::Orbit, Noise::default(), 2).problem;
    // A small part, with one image seeing a point twice.
    problem.points.truncate(12);
    problem.track_start.truncate(13);
    let end = problem.track_start[12] as usize;
    problem.observation_image.truncate(end);
    problem.observation_ray.truncate(end);
    problem.observation_image[1] = problem.observation_image[0];
    let layout = Layout::new(&problem, None).unwrap();
    let mut random = Random(5);
    for shape in [Shape::Full, Shape::Isotropic] {
        let blocks: Vec<Block<f64>> = (0..layout.observations())
            .map(|o| match (o % 7, shape) {
                (3, _) => Block::masked(),
                (_, Shape::Full) if o % 3 > 0 => Block {
                    direction: random.normals().normalize().to_array(),
                    scale: random.uniform(0.2, 2.0),
                    gradient: random.normals().to_array(),
                },
                _ => Block {
                    direction: [0.0; 3],
                    scale: random.uniform(0.2, 2.0),
                    gradient: random.normals().to_array(),
                },
            })
            .collect();
        let (lambda, cameras) = (0.01, layout.cameras());
        let size = 3 * (cameras + layout.points());
        let (mut matrix, mut right) = (vec![vec![0.0; size]; size], vec![0.0; size]);
        for (o, block) in blocks.iter().enumerate() {
            let (c, x) = (3 * layout.camera[o] as usize, 3 * (cameras + layout.point[o] as usize));
            for row in 0..3 {
                for column in 0..3 {
                    let mut unit = [0.0; 3];
                    unit[column] = 1.0;
                    let m = block.apply(unit)[row];
                    matrix[c + row][c + column] += m;
                    matrix[x + row][x + column] += m;
                    matrix[c + row][x + column] -= m;
                    matrix[x + row][c + column] -= m;
                }
                right[c + row] += block.gradient[row];
                right[x + row] -= block.gradient[row];
            }
        }
        for k in (0..size).step_by(3) {
            let damping = floored([matrix[k][k], matrix[k + 1][k + 1], matrix[k + 2][k + 2]]);
            for axis in 0..3 {
                let diagonal = &mut matrix[k + axis][k + axis];
                // What no observation touches stays where it is.
                *diagonal =
                    if *diagonal == 0.0 && damping[axis] == 0.0 { 1.0 } else { *diagonal + lambda * damping[axis] };
            }
        }
        let expected = dense_solve(matrix, right);
        let mut normal = block_on(Normal::new(&layout, shape, LinearSolver::Cholesky, &mut ())).unwrap();
        block_on(normal.gather(&layout, &blocks, &mut ()));
        let step = block_on(normal.solve(&layout, &blocks, lambda, &mut ())).unwrap();
        let found = step.centers.iter().chain(&step.points).flatten();
        for (found, expected) in found.zip(&expected) {
            assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{shape:?} {found} {expected}");
        }
        assert!(step.predicted_decrease > 0.0);
    }
}
