//! Incremental residuals must survive the compiler: for steps of any size the change of the cost has the relative
//! accuracy of `f32`, where a difference of two costs is noise (source: `solver.md` §1.3 d, §7 level 2, experiment R7).

use epipole_geometry::camera::project;
use glam::{DMat3, DVec3};

use super::bench::Bench;
use super::trace::Trace;
use crate::bundle::gpu::GpuSystem;
use crate::bundle::gpu::records::{Intrinsics, Point, View};
use crate::bundle::{Options, Problem};
use crate::common_for_tests as common;
use crate::gpu::tests::device;

/// A state as the kernels store it.
struct Stored {
    views: Vec<View>,
    intrinsics: Vec<Intrinsics>,
    points: Vec<Point>,
}

fn real(word: u32) -> f64 {
    f64::from(f32::from_bits(word))
}

fn moved(word: u32, by: f64) -> u32 {
    ((real(word) + by) as f32).to_bits()
}

impl Stored {
    /// Every number changed by about `step` of its own scale, and rounded.
    fn stepped(&self, cell: f64, step: f64) -> Self {
        let mut seed = 1u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            step * ((seed >> 40) as f64 / f64::from(1u32 << 23) - 1.0)
        };
        let mut views = self.views.clone();
        for view in &mut views {
            let turn = DMat3::from_euler(glam::EulerRot::XYZ, random(), random(), random());
            let row = |k: usize| DVec3::new(real(view[4 * k]), real(view[4 * k + 1]), real(view[4 * k + 2]));
            let rows = [row(0), row(1), row(2)].map(|row| turn.transpose() * row);
            for (k, row) in rows.iter().enumerate() {
                for j in 0..3 {
                    view[4 * k + j] = (row[j] as f32).to_bits();
                }
                view[4 * k + 3] = moved(view[4 * k + 3], cell * random());
            }
        }
        let mut intrinsics = self.intrinsics.clone();
        for camera in &mut intrinsics {
            // One focal length for both axes.
            camera[0] = moved(camera[0], real(camera[0]) * random());
            camera[1] = camera[0];
        }
        let mut points = self.points.clone();
        for point in &mut points {
            (0..3).for_each(|k| point[k] = moved(point[k], cell * random()));
        }
        Self { views, intrinsics, points }
    }

    /// The residual of an observation in `f64`.
    fn residual(&self, problem: &Problem, cell: f64, point: usize, image: usize, px: [f32; 2]) -> [f64; 2] {
        let (view, point) = (&self.views[image], &self.points[point]);
        let ray = DVec3::from_array(std::array::from_fn(|k| {
            let cells = i64::from(point[3] >> (10 * k) & 1023) - i64::from(view[12 + k] as i32);
            cell * cells as f64 + (real(point[k]) - real(view[4 * k + 3]))
        }));
        let q: [f64; 3] = std::array::from_fn(|k| (0..3).map(|j| real(view[4 * k + j]) * ray[j]).sum::<f64>());
        let camera = &problem.cameras[problem.image_camera[image] as usize];
        let mut params = camera.params.clone();
        params.iter_mut().for_each(|p| *p = f64::from(*p as f32));
        params[0] = real(self.intrinsics[problem.image_camera[image] as usize][0]);
        let found = project(camera.model, &params, q).expect("in front");
        [found[0] - f64::from(px[0]), found[1] - f64::from(px[1])]
    }
}

#[test]
fn incremental_residuals_are_as_accurate_for_the_smallest_steps() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::Scene::default());
    common::perturb(&mut problem, 0.3, 0.02, 3);
    for step in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7] {
        let system = GpuSystem::new(&device, &problem, &Options::default()).expect("a good problem");
        let bench = Bench { system };
        let (layout, resident) = (&bench.system.layout, &bench.system.resident);
        let cell = layout.lattice.cell;
        let [chunk] = &layout.chunks[..] else { panic!("one chunk") };
        let before =
            Stored { views: layout.views.clone(), intrinsics: layout.intrinsics.clone(), points: chunk.points.clone() };
        let after = before.stepped(cell, step);
        let buffers = &resident.buffers;
        let blocks = [&before.views[..], &after.views, &before.views].concat();
        device.write(&buffers.views, &blocks);
        let cameras = [&before.intrinsics[..], &after.intrinsics, &before.intrinsics].concat();
        device.write(&buffers.intrinsics, &layout.sizes.pack(&cameras));
        let mut points = before.points.clone();
        for (point, after) in points.iter_mut().zip(&after.points) {
            point[4..7].copy_from_slice(&after[..3]);
        }
        device.write(&resident.chunks[0].points, &points);
        bench.dispatch("refresh");
        let base = bench.words(&resident.chunks[0].residuals, 4 * chunk.by_point.len());
        bench.dispatch("change_camera");
        bench.dispatch("change_point");
        let trace = Trace::begin(&bench.system, "trial", &format!("step{step:e}-"));
        bench.dispatch("trial");

        // The change of Σ‖r‖² from the residuals that the device holds, its terms, and what is left of it where both
        // residuals are rounded to f32, as two costs would have them.
        let (mut exact, mut terms, mut rounded) = (0.0, 0.0, 0.0);
        for (p, track) in chunk.tracks.windows(2).enumerate() {
            for o in track[0] as usize..track[1] as usize {
                let image = chunk.by_point[o] as usize;
                let [r, r2] = [&before, &after].map(|s| s.residual(&problem, cell, p, image, chunk.pixels[o]));
                for k in 0..2 {
                    let (change, base) = (r2[k] - r[k], f64::from(base[4 * o + k]));
                    exact += change * (2.0 * base + change);
                    terms += (change * (2.0 * base + change)).abs();
                    rounded += f64::from(r2[k] as f32).powi(2) - f64::from(r[k] as f32).powi(2);
                }
            }
        }
        if let Some(trace) = trace {
            trace.end(&bench.system, Some(exact));
        }
        let rows = bench.words(&resident.buffers.trial_sums, 8 * resident.params.point_groups as usize);
        let found: f64 = rows.chunks(8).map(|row| f64::from(row[0])).sum();
        let error = (found - exact).abs();
        println!(
            "step {step:.0e}: change {exact:+.6e}, off by {:.1e} of it and {:.1e} of Σ|terms|; by rounded residuals {:.1e}",
            error / exact.abs(),
            error / terms,
            (rounded - exact).abs() / exact.abs()
        );
        assert!(error <= 1e-6 * terms, "{found} {exact} {terms}");
    }
}
