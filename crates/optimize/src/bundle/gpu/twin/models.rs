//! Every camera model of the device against `epipole_geometry`, ray by ray.

use epipole_geometry::camera::{CameraModel, Real, project, project_difference, project_with_derivatives};
use pollster::block_on;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::bench::compare;
use super::num::{Bounded, Num};
use crate::bundle::gpu::records::{intrinsics, param_slot};
use crate::bundle::gpu::sizes::Sizes;
use crate::common_for_tests::LENSES;
use crate::gpu::kernels::CAMERA_PROBE;
use crate::gpu::tests::device;
use crate::gpu::{Device, Pipelines, Variant};

/// A camera and a ray, with a step of both.
struct Sample {
    params: Vec<f32>,
    d_params: Vec<f32>,
    ray: [f32; 3],
    d_ray: [f32; 3],
    px: [f32; 2],
}

/// What the device says of a sample.
struct Answer {
    sees: bool,
    /// Residual, change, derivative by the ray.
    values: [f32; 10],
    /// By the parameters, in the model's order.
    params: [Vec<f32>; 2],
}

fn sample(rng: &mut Pcg64Mcg, model: CameraModel, params: &[f64]) -> Sample {
    let mut random = || 2.0 * rng.random::<f64>() - 1.0;
    // Up to 75° from the axis for lenses that are made for it, 45° for others, everywhere for a sphere.
    let far = match model.focal_params().len() {
        0 => std::f64::consts::PI,
        _ if model.family() == epipole_geometry::camera::CameraFamily::Fisheye => 1.3,
        _ => 0.75,
    };
    let (angle, turn, depth) = (far * random(), 3.0 * random(), 3.0 + 2.0 * random());
    let ray = [angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos()].map(|v| depth * v);
    // Steps of a tenth down to a millionth.
    let step = 10f64.powf(-3.5 + 2.5 * random());
    let params: Vec<f32> = params.iter().map(|p| (p * (1.0 + 0.1 * random())) as f32).collect();
    Sample {
        d_params: params.iter().map(|p| p * (0.3 * step * random()) as f32).collect(),
        params,
        ray: ray.map(|v| v as f32),
        d_ray: [0; 3].map(|_| (step * depth * random()) as f32),
        px: [0; 2].map(|_| (500.0 + 500.0 * random()) as f32),
    }
}

fn ask(device: &Device, variant: Variant, model: CameraModel, samples: &[Sample]) -> Vec<Answer> {
    let sizes = Sizes::of(variant);
    let width = 11 + 2 * sizes.params;
    let cameras: Vec<_> = samples
        .iter()
        .flat_map(|s| [&s.params, &s.d_params])
        .map(|params| intrinsics(model, &params.iter().map(|&p| f64::from(p)).collect::<Vec<_>>()))
        .collect();
    let rays: Vec<[f32; 4]> = samples
        .iter()
        .flat_map(|s| {
            let four = |v: [f32; 3]| [v[0], v[1], v[2], 0.0];
            [four(s.ray), four(s.d_ray), [s.px[0], s.px[1], 0.0, 0.0]]
        })
        .collect();
    let run = || {
        let pipelines = Pipelines::for_variant(device, &[CAMERA_PROBE], variant)?;
        let params = device.uniform("params", &[samples.len() as u32, 0, 0, 0])?;
        let cameras = device.storage("cameras", &sizes.pack(&cameras))?;
        let rays = device.storage("rays", &rays)?;
        let rows = device.zeroed("rows", (samples.len() * width * 4) as u64)?;
        let bound = pipelines.bind(device, &CAMERA_PROBE, &[&params, &cameras, &rays, &rows])?;
        let mut encoder = device.encoder();
        bound.dispatch(&mut encoder, samples.len().div_ceil(64) as u64)?;
        device.submit(encoder);
        block_on(device.download::<f32>(&rows, samples.len() * width))
    };
    let rows = run().expect("a live device");
    let by_params = |row: &[f32]| (0..model.num_params()).map(|k| row[param_slot(model, k)]).collect();
    let answer = |row: &[f32]| Answer {
        sees: row[2] == 1.0,
        values: std::array::from_fn(|k| row[if k < 2 { k } else { k + 1 }]),
        params: [by_params(&row[11..]), by_params(&row[11 + sizes.params..])],
    };
    rows.chunks_exact(width).map(answer).collect()
}

/// The same by the CPU's cameras; `None` where they see nothing.
fn expect<N: Num + Real>(model: CameraModel, s: &Sample) -> Option<([N; 10], [Vec<N>; 2])> {
    let all = |values: &[f32]| -> Vec<N> { values.iter().map(|&v| N::of(v)).collect() };
    let (params, ray, d_ray) = (all(&s.params), s.ray.map(N::of), s.d_ray.map(N::of));
    let pixel = project(model, &params, ray)?;
    let change = project_difference(model, &params, &all(&s.d_params), ray, d_ray)?;
    let derivative = project_with_derivatives(model, &params, ray)?;
    let residual = [pixel[0] - N::of(s.px[0]), pixel[1] - N::of(s.px[1])];
    let values = residual.into_iter().chain(change).chain(derivative.d_point.into_iter().flatten());
    let mut out = [N::of(0.0); 10];
    out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
    Some((out, derivative.d_params.map(|row| row[..model.num_params()].to_vec())))
}

#[test]
fn every_model_agrees_with_the_cpu_near_and_far_from_the_axis_for_steps_of_every_size() {
    let Some(device) = device() else { return };
    for (variant, lenses) in [(Variant::default(), &LENSES[..5]), (Variant::WIDE, &LENSES[..])] {
        for &(model, params) in lenses {
            let mut rng = Pcg64Mcg::seed_from_u64(11);
            let samples: Vec<_> = (0..300).map(|_| sample(&mut rng, model, params)).collect();
            let answers = ask(&device, variant, model, &samples);
            let seen: Vec<_> = samples.iter().zip(&answers).filter(|(_, answer)| answer.sees).collect();
            assert!(seen.len() > 150, "{model:?}: {}", seen.len());
            let name = |what| format!("{model:?} {:?} {what}", variant.flags().collect::<Vec<_>>());
            let twin = |s| expect::<f32>(model, s).expect("the CPU sees it too");
            let exact = |s| expect::<Bounded>(model, s).expect("the CPU sees it too");
            for (what, range) in [("residual", 0..2), ("change", 2..4), ("by ray", 4..10)] {
                compare(
                    &name(what),
                    seen.iter().flat_map(|(_, a)| &a.values[range.clone()]),
                    seen.iter().flat_map(|(s, _)| twin(s).0[range.clone()].to_vec()),
                    seen.iter().flat_map(|(s, _)| exact(s).0[range.clone()].to_vec()),
                );
            }
            compare(
                &name("by parameters"),
                seen.iter().flat_map(|(_, a)| a.params.iter().flatten()),
                seen.iter().flat_map(|(s, _)| twin(s).1.concat()),
                seen.iter().flat_map(|(s, _)| exact(s).1.concat()),
            );
        }
    }
}

#[test]
fn a_model_sees_what_it_sees_on_the_cpu() {
    let Some(device) = device() else { return };
    for (model, params) in LENSES {
        let mut rng = Pcg64Mcg::seed_from_u64(12);
        // Behind the camera, and far from the axis with distortion strong enough to end the model's domain.
        let strong: Vec<f64> = match model {
            CameraModel::SimpleDivision | CameraModel::Division => params.iter().map(|p| p.abs().max(0.4)).collect(),
            CameraModel::FullOpenCv => params.iter().enumerate().map(|(k, p)| if k > 8 { -0.2 } else { *p }).collect(),
            CameraModel::Eucm => params.iter().enumerate().map(|(k, p)| if k == 5 { -0.9 } else { *p }).collect(),
            _ => params.to_vec(),
        };
        let mut samples: Vec<_> = (0..400).map(|_| sample(&mut rng, model, &strong)).collect();
        samples.iter_mut().step_by(2).for_each(|s| s.ray[2] *= 0.5);
        samples.iter_mut().step_by(3).for_each(|s| s.ray[2] = -s.ray[2]);
        let answers = ask(&device, Variant::WIDE, model, &samples);
        let mut counts = [0; 2];
        for (s, answer) in samples.iter().zip(&answers) {
            assert_eq!(answer.sees, expect::<Bounded>(model, s).is_some(), "{model:?} {:?} {:?}", s.ray, s.params);
            counts[usize::from(answer.sees)] += 1;
        }
        assert!(counts[1] > 50 && (counts[0] > 100 || model == CameraModel::Equirectangular), "{model:?}: {counts:?}");
    }
}
