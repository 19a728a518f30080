//! Every camera model through the same tests: values, derivatives, differences, and the way back.

use glam::{DVec2, DVec3};

use super::colmap_pixels::{CASES, POINTS};
use super::*;

/// Random numbers in −1..1, the same on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A point in front of the camera, up to 45° from the axis (and behind for the equirectangular model).
    fn point(&mut self, model: CameraModel) -> DVec3 {
        let depth = 2.0 + 1.5 * self.next();
        let point = DVec3::new(0.7 * depth * self.next(), 0.7 * depth * self.next(), depth);
        if model == CameraModel::Equirectangular && self.next() < 0.0 {
            point * DVec3::new(1.0, 1.0, -1.0)
        } else {
            point
        }
    }
}

#[test]
fn pixels_agree_with_colmap() {
    for (i, (model, params, pixels)) in CASES.into_iter().enumerate() {
        assert_eq!(model.id(), i as i32, "the table holds every model once");
        assert_eq!(params.len(), model.num_params());
        for (point, pixel) in POINTS.into_iter().zip(pixels) {
            let ours = project(model, params, point).expect("in front");
            let error = DVec2::from_array(ours).distance(DVec2::from_array(pixel));
            assert!(error < 1e-10, "{model:?} {point:?}: {ours:?} instead of {pixel:?}");
        }
    }
}

#[test]
fn derivatives_agree_with_central_differences() {
    let mut random = Random(1);
    for (model, params, _) in CASES {
        for _ in 0..50 {
            let point = random.point(model).to_array();
            let analytic = project_with_derivatives(model, params, point).expect("in front");
            assert!(
                DVec2::from_array(analytic.pixel)
                    .distance(DVec2::from_array(project(model, params, point).expect("in front")))
                    < 1e-10
            );
            let central = |column: usize| {
                let at = |sign: f64| {
                    let (mut params, mut point) = (params.to_vec(), point);
                    let target = if column < 3 { &mut point[column] } else { &mut params[column - 3] };
                    let step = sign * 1e-5 * target.abs().max(1e-1);
                    *target += step;
                    (DVec2::from_array(project(model, &params, point).expect("in front")), step)
                };
                let ((a, step_a), (b, step_b)) = (at(1.0), at(-1.0));
                (a - b) / (step_a - step_b)
            };
            for column in 0..3 + params.len() {
                let numeric = central(column);
                for row in 0..2 {
                    let exact =
                        if column < 3 { analytic.d_point[row][column] } else { analytic.d_params[row][column - 3] };
                    let scale = 1.0 + numeric.length();
                    assert!((exact - numeric[row]).abs() < 1e-6 * scale, "{model:?} {column} {row}: {exact} {numeric}");
                }
            }
            for row in 0..2 {
                assert!(analytic.d_params[row][params.len()..].iter().all(|&d| d == 0.0));
            }
        }
    }
}

#[test]
fn derivatives_in_f32_are_those_in_f64() {
    let mut random = Random(4);
    for (model, params, _) in CASES {
        for _ in 0..20 {
            let point = random.point(model).to_array();
            let wide = project_with_derivatives(model, params, point).expect("in front");
            let params: Vec<f32> = params.iter().map(|&p| p as f32).collect();
            let narrow = project_with_derivatives(model, &params, point.map(|v| v as f32)).expect("in front");
            let all =
                |p: &Projection<f64>| p.d_point.iter().flatten().chain(p.d_params.iter().flatten()).copied().collect();
            let narrow = Projection {
                pixel: narrow.pixel.map(f64::from),
                d_point: narrow.d_point.map(|r| r.map(f64::from)),
                d_params: narrow.d_params.map(|r| r.map(f64::from)),
            };
            let (wide, narrow): (Vec<f64>, Vec<f64>) = (all(&wide), all(&narrow));
            let largest = wide.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            for (a, b) in wide.iter().zip(&narrow) {
                assert!((a - b).abs() < 5e-6 * largest, "{model:?}: {a} {b}");
            }
        }
    }
}

#[test]
fn derivatives_are_finite_on_the_axis_and_without_distortion() {
    for model in CameraModel::ALL {
        let mut camera = Camera::with_default_params(1, model, 1000, 700);
        for &i in model.extra_params() {
            camera.params[i] = 0.0;
        }
        let p = project_with_derivatives(model, &camera.params, [0.0, 0.0, 2.0]).expect("in front");
        assert!(p.d_point.iter().flatten().chain(p.d_params.iter().flatten()).all(|v| v.is_finite()), "{model:?}");
        let focal_px = camera.mean_focal_px();
        if model != CameraModel::Equirectangular {
            assert!((p.d_point[0][0] - focal_px / 2.0).abs() < 1e-9 * focal_px, "{model:?}");
        }
        let params: Vec<f32> = camera.params.iter().map(|&v| v as f32).collect();
        let zeros = [0.0; MAX_PARAMS];
        let moved = project_difference(model, &params, &zeros[..params.len()], [0.0, 0.0, 2.0], [1e-3, 0.0, 0.0]);
        let moved = moved.expect("in front");
        let expected = p.d_point[0][0] as f32 * 1e-3;
        assert!((moved[0] - expected).abs() < 1e-5 * expected && moved[1] == 0.0, "{model:?}: {moved:?} {expected}");
    }
}

#[test]
fn pixel_to_ray_and_back() {
    let mut random = Random(2);
    for (model, params, _) in CASES {
        let camera = Camera { params: params.to_vec(), ..Camera::with_default_params(1, model, 1000, 700) };
        for _ in 0..200 {
            let point = random.point(model);
            let px = camera.project(point).expect("in front");
            let ray = camera.ray_from_pixel(px).expect("a pixel that a point projects to has a ray");
            assert!((ray.length() - 1.0).abs() < 1e-14);
            assert!(ray.distance(point.normalize()) < 1e-12, "{model:?} {point} {ray}");
            assert!(camera.project(ray).expect("in front").distance(px) < 1e-9, "{model:?} {px}");
        }
    }
}

/// The error of a difference in `f32` is at most 1e-6 of what the step changes, from steps of 1e-7 to 1e-1.
#[test]
fn differences_in_f32_keep_their_digits() {
    let mut random = Random(3);
    for (model, params, _) in CASES {
        let params: Vec<f32> = params.iter().map(|&p| p as f32).collect();
        for size in [1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1] {
            for _ in 0..50 {
                let point = random.point(model).to_array().map(|v| v as f32);
                let step = [(); 3].map(|()| (size * random.next()) as f32);
                let steps: Vec<f32> =
                    params.iter().map(|&p| (0.1 * size * f64::from(p) * random.next()) as f32).collect();
                let wide = |v: &[f32]| v.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
                let (p0, dp, x0, dx) = (wide(&params), wide(&steps), wide(&point), wide(&step));
                let p1: Vec<f64> = p0.iter().zip(&dp).map(|(a, b)| a + b).collect();
                let x1: Vec<f64> = x0.iter().zip(&dx).map(|(a, b)| a + b).collect();
                let to_array = |v: &[f64]| [v[0], v[1], v[2]];
                let before = project_with_derivatives(model, &p0, to_array(&x0)).expect("in front");
                let after = project(model, &p1, to_array(&x1)).expect("in front");
                let ours = project_difference(model, &params, &steps, point, step).expect("in front");
                for row in 0..2 {
                    let expected = after[row] - before.pixel[row];
                    // What the parts of the step contribute; their sum may cancel, and no method keeps more digits.
                    let parts: f64 = before.d_point[row].iter().zip(&dx).map(|(j, d)| (j * d).abs()).sum::<f64>()
                        + before.d_params[row].iter().zip(&dp).map(|(j, d)| (j * d).abs()).sum::<f64>();
                    let scale = parts.max(expected.abs());
                    // The f64 reference itself subtracts pixels of a thousand: its own rounding is allowed for.
                    let error = ((f64::from(ours[row]) - expected).abs() - 1e-12).max(0.0);
                    assert!(error <= 1e-6 * scale, "{model:?} step {size}: {} instead of {expected}", ours[row]);
                }
            }
        }
    }
}

#[test]
fn a_step_onto_the_axis_keeps_its_digits() {
    for (model, params, _) in CASES {
        let params: Vec<f32> = params.iter().map(|&p| p as f32).collect();
        let point = [0.5f32, -0.25, 2.0];
        let ours = project_difference(model, &params, &[0.0; MAX_PARAMS][..params.len()], point, [-0.5, 0.25, 0.0]);
        let ours = ours.expect("in front");
        let wide: Vec<f64> = params.iter().map(|&p| f64::from(p)).collect();
        let before = project(model, &wide, point.map(f64::from)).expect("in front");
        let after = project(model, &wide, [0.0, 0.0, 2.0]).expect("in front");
        for row in 0..2 {
            let expected = after[row] - before[row];
            assert!((f64::from(ours[row]) - expected).abs() < 1e-6 * expected.abs(), "{model:?} {ours:?} {expected}");
        }
    }
}

#[test]
fn nothing_is_seen_behind() {
    for (model, params, _) in CASES {
        let sees_all = model == CameraModel::Equirectangular;
        for point in [[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]] {
            assert_eq!(project(model, params, point).is_some(), sees_all, "{model:?}");
            assert_eq!(project_with_derivatives(model, params, point).is_some(), sees_all, "{model:?}");
        }
        let zeros = vec![0.0; params.len()];
        let difference = project_difference(model, params, &zeros, [0.1, 0.2, 1.0], [0.0, 0.0, -2.0]);
        assert_eq!(difference.is_some(), sees_all, "{model:?}: a step behind the camera");
        assert_eq!(project(model, params, [f64::NAN; 3]).filter(|px| px[0].is_finite()), None, "{model:?}");
        assert_eq!(project(model, params, [0.0; 3]), None, "{model:?}");
    }
}

#[test]
fn rays_beyond_the_models_are_refused() {
    let camera =
        |model, params: &[f64]| Camera { params: params.to_vec(), ..Camera::with_default_params(1, model, 1000, 700) };
    // r(1 − 0.5 r²) has its largest value 0.544 at r = 0.816: the pixel lies beyond.
    let barrel = camera(CameraModel::SimpleRadial, &[1000.0, 500.0, 350.0, -0.5]);
    assert_eq!(barrel.ray_from_pixel(DVec2::new(1100.0, 350.0)), None);
    assert!(barrel.ray_from_pixel(DVec2::new(1000.0, 350.0)).is_some());
    // 100° from the axis.
    let fisheye = camera(CameraModel::SimpleFisheye, &[100.0, 500.0, 350.0]);
    assert_eq!(fisheye.ray_from_pixel(DVec2::new(500.0 + 100.0 * 100f64.to_radians(), 350.0)), None);
    let division = camera(CameraModel::SimpleDivision, &[100.0, 500.0, 350.0, -0.1]);
    assert_eq!(division.ray_from_pixel(DVec2::new(1000.0, 350.0)), None);
    assert_eq!(division.project(DVec3::new(1.0, 1.0, 1.0)).map(|px| px.is_finite()), Some(true));
    let division = camera(CameraModel::SimpleDivision, &[100.0, 500.0, 350.0, 0.2]);
    assert_eq!(division.project(DVec3::new(2.0, 1.0, 1.0)), None, "the root is negative");
    for model in CameraModel::ALL {
        assert_eq!(Camera::with_default_params(1, model, 640, 480).ray_from_pixel(DVec2::NAN), None, "{model:?}");
    }
}

/// Nanoseconds per projection with derivatives; run with
/// `cargo test --release -p epipole-geometry -- --ignored --nocapture speed_of_derivatives`.
#[test]
#[ignore = "a measurement, not a check"]
fn speed_of_derivatives() {
    const COUNT: usize = 2_000_000;
    for (model, params, _) in CASES {
        let start = std::time::Instant::now();
        let mut sum = 0.0;
        for i in 0..COUNT {
            let point = [0.1 + 1e-7 * i as f64, 0.2, 1.5];
            std::hint::black_box(project_with_derivatives(model, std::hint::black_box(params), point));
        }
        let derivatives = start.elapsed().as_secs_f64() * 1e9 / COUNT as f64;
        let start = std::time::Instant::now();
        let zeros = [1e-6; MAX_PARAMS];
        for i in 0..COUNT {
            let point = [0.1 + 1e-7 * i as f64, 0.2, 1.5];
            let change =
                project_difference(model, std::hint::black_box(params), &zeros[..params.len()], point, [1e-6; 3]);
            sum += change.map_or(0.0, |c| c[0] + c[1]);
        }
        let difference = start.elapsed().as_secs_f64() * 1e9 / COUNT as f64;
        let start = std::time::Instant::now();
        let camera = Camera { params: params.to_vec(), ..Camera::with_default_params(1, model, 1000, 700) };
        for i in 0..COUNT / 10 {
            let px = DVec2::new(300.0 + 1e-3 * i as f64, 200.0);
            sum += camera.ray_from_pixel(px).map_or(0.0, |r| r.x);
        }
        let ray = start.elapsed().as_secs_f64() * 1e10 / COUNT as f64;
        println!(
            "{:28} derivatives {derivatives:6.1} ns, difference {difference:6.1} ns, ray {ray:6.1} ns ({sum:.3})",
            model.name()
        );
    }
}
