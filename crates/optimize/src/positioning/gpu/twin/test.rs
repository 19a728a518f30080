//! Every kernel of every stage on a device against its twins, each from the device's own state before it.

use glam::DVec3;

use super::check_linear::{check_linearization, check_preconditioner};
use super::check_step::{check_gauge, check_pcg, check_step};
use super::state::State;
use crate::bundle::gpu::twin::bench::compare;
use crate::bundle::gpu::twin::num::Bounded;
use crate::gpu::Device;
use crate::gpu::kernels::Kernel;
use crate::gpu::tests::device;
use crate::positioning::Problem;
use crate::positioning::gauge::Positions;
use crate::positioning::gpu::chunks::CHUNK_OBSERVATIONS;
use crate::positioning::gpu::processor::Gpu;
use crate::positioning::gpu::records::{Gauge, Stage};
use crate::positioning::layout::{Layout, Rays};
use crate::positioning::tests::metric::{doubt, pin};
use crate::positioning::tests::scene::{Kind, Noise, Random, Scene, scene};
use crate::positioning::vec3::from_dvec3;

/// Numbers of the device, and what both twins find instead.
#[derive(Default)]
pub(super) struct Numbers {
    pub(super) found: Vec<f32>,
    twin: Vec<f32>,
    exact: Vec<Bounded>,
}

impl Numbers {
    pub(super) fn expect(&mut self, twin: impl IntoIterator<Item = f32>, exact: impl IntoIterator<Item = Bounded>) {
        self.twin.extend(twin);
        self.exact.extend(exact);
    }

    pub(super) fn check(self, what: &str) {
        compare(what, &self.found, self.twin, self.exact);
    }
}

pub(super) fn run(gpu: &Gpu<'_>, kernel: Kernel) {
    let mut encoder = gpu.device().encoder();
    gpu.resident.record(&mut encoder, &[kernel]).expect("fits");
    gpu.device().submit(encoder);
}

pub(super) fn states(gpu: &Gpu<'_>) -> (State<f32>, State<Bounded>) {
    (State::download(gpu), State::download(gpu))
}

/// All kernels, for every objective, from near the truth.
fn check(device: &Device, scene: &Scene, mask: impl Fn(usize, u32) -> bool, chunk_observations: usize) {
    let layout = Layout::new(&scene.problem, None).expect("tracks");
    let mut rays = Rays::<f32>::new(&scene.problem, &layout);
    for (o, weight) in rays.weight.iter_mut().enumerate() {
        if mask(layout.point[o] as usize, layout.camera[o]) {
            *weight = 0.0;
        }
    }
    let mut random = Random(17);
    let mut near = |p: DVec3| from_dvec3(p + 0.2 * random.normals());
    let start = Positions {
        centers: layout.image_of_camera.iter().map(|&i| near(scene.centers[i as usize])).collect(),
        points: layout.source_point.iter().map(|&p| near(scene.points[p as usize])).collect(),
    };
    for stage in [Stage::EqualScales, Stage::Lud, Stage::Project] {
        println!("{stage:?}, {} observations", layout.observations());
        let mut gpu = Gpu::new(device, &layout, &rays, chunk_observations).expect("fits");
        gpu.upload(&start);
        gpu.settings.stage = stage;
        (gpu.settings.huber, gpu.settings.huber_pinned) = (0.05, 0.1);
        // Half the rays are longer than the bound of LUD; a good scale; the least one.
        (gpu.settings.bound, gpu.settings.delta) = match stage {
            Stage::EqualScales => (0.1, 0.0),
            Stage::Lud => (6.0, 0.3),
            Stage::Project => (1e-5, 0.0),
        };
        gpu.settings.lambda = 1e-4;
        gpu.settings.pcg.eta = 0.0;
        check_gauge(&mut gpu, if stage == Stage::Project { Gauge::Start } else { Gauge::Keep });
        check_linearization(&gpu);
        check_preconditioner(&gpu);
        check_pcg(&gpu);
        check_step(&gpu);
        check_gauge(&mut gpu, if stage == Stage::Project { Gauge::Follow } else { Gauge::Keep });
    }
}

const NOISE: Noise = Noise { ray_rad: 5e-3, rotation_deg: 1.0, outliers: 0.1 };

#[test]
fn kernels_agree_with_their_twins_where_cameras_and_points_have_little_left() {
    let Some(device) = device() else { return };
    let mut scene = scene(Kind::Facade, NOISE, 2);
    scene.problem.image_weight[4] = 0.5;
    // Rays that point backwards, one camera without any ray, points with one and with none.
    scene.problem.observation_ray.iter_mut().step_by(50).for_each(|ray| *ray = -*ray);
    let few = |point: usize, camera: u32| camera == 3 || point == 5 || (point == 6 && !camera.is_multiple_of(7));
    check(&device, &scene, few, CHUNK_OBSERVATIONS);
    pin(&mut scene, 0.3, 0.1);
    doubt(&mut scene);
    check(&device, &scene, few, 1000);
}

/// A point that the given images see.
fn add_point(scene: &mut Scene, point: DVec3, images: impl Iterator<Item = usize>) {
    let problem: &mut Problem = &mut scene.problem;
    for image in images {
        problem.observation_image.push(image as u32);
        problem.observation_ray.push((point - scene.centers[image]).normalize());
    }
    problem.track_start.push(problem.observation_image.len() as u32);
    problem.points.push(DVec3::ZERO);
    scene.points.push(point);
}

#[test]
fn kernels_agree_with_their_twins_on_large_cameras_and_long_tracks() {
    let Some(device) = device() else { return };
    let mut scene = scene(Kind::Orbit, NOISE, 2);
    let mut random = Random(3);
    for k in 0..10_000 {
        add_point(&mut scene, random.normals(), [7, 8 + k % 40].into_iter());
    }
    add_point(&mut scene, DVec3::new(0.1, 0.2, -0.1), (0..500).map(|k| k % 50));
    check(&device, &scene, |_, _| false, CHUNK_OBSERVATIONS);
    pin(&mut scene, 0.3, 0.1);
    doubt(&mut scene);
    check(&device, &scene, |_, _| false, 7000);
}
