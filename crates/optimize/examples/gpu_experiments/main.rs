//! Experiments of `solver.md` §8 about the device, not about the product: `gpu_experiments [store|gather|dispatch]`, all
//! without a word. Figures and what they settle: `docs/gpu-experiments.md`. In Chromium: `cargo xtask experiments`.

mod raw;
mod street;

use std::process::ExitCode;
use std::time::Instant;

use raw::{Gpu, Seconds};
use street::Street;

/// One pipeline's groups for a street.
struct Operator<'a> {
    gpu: &'a Gpu,
    module: raw::Module,
    street: Street,
    sums: wgpu::Buffer,
    /// With Jacobians in the points' and in the images' order.
    groups: [wgpu::BindGroup; 2],
}

const FORMS: [(&str, &str, &str); 3] = [
    ("recomputed", "row_of(x, camera, by_point[o].weight)", "row_of(points[p].x.xyz, camera, by_image[o].weight)"),
    ("stored32", "load32(o)", "load32(o)"),
    ("stored16", "load16(o)", "load16(o)"),
];

fn source() -> String {
    let form = |(name, by_point, by_image): (&str, &str, &str)| {
        let text = include_str!("form.wgsl").replace("NAME", name);
        text.replace("LOAD_POINT", by_point).replace("LOAD_CAMERA", by_image)
    };
    let fill = |bits: &str| include_str!("fill.wgsl").replace("BITS", bits);
    let forms: String = FORMS.map(form).concat() + &fill("32") + &fill("16");
    include_str!("operator.wgsl").replace("FORMS", &forms)
}

impl<'a> Operator<'a> {
    fn new(gpu: &'a Gpu, street: Street, stores: bool) -> Self {
        let module = gpu.module(&source(), "urwrrrrww");
        let params = gpu.buffer(&[street.points.len() as u32, street.segments.len() as u32, 0, 0], true);
        let points = gpu.buffer(&street.points, false);
        let sums = gpu.zeroed(48 * street.segments.len() as u64);
        let cameras = gpu.buffer(&street.cameras, false);
        let tracks = gpu.buffer(&street.tracks, false);
        let by_point = gpu.buffer(&street.by_point, false);
        let segments = gpu.buffer(&street.segments, false);
        let by_image = gpu.buffer(&street.by_image, false);
        let stored = || gpu.zeroed(if stores { 96 * street.by_point.len() as u64 } else { 16 });
        let group = |stored: &wgpu::Buffer| {
            let all = [&params, &cameras, &points, &tracks, &by_point, &segments, &by_image, stored, &sums];
            gpu.group(&module, &all)
        };
        let groups = [group(&stored()), group(&stored())];
        Self { gpu, module, street, sums, groups }
    }

    fn extents(&self) -> [u32; 2] {
        [self.street.points.len().div_ceil(64) as u32, self.street.segments.len() as u32]
    }

    /// Seconds of the point and the camera half.
    fn time(&self, form: &str) -> [Seconds; 2] {
        let [points, segments] = self.extents();
        let one = |half: &str, group: &wgpu::BindGroup, groups: u32| {
            let pipeline = self.gpu.pipeline(&self.module, &format!("{form}_{half}"));
            self.gpu.time(5, || self.gpu.submit(&[(&pipeline, group, groups)]))
        };
        [one("point", &self.groups[0], points), one("camera", &self.groups[1], segments)]
    }

    fn fill(&self, bits: &str) {
        for (half, (group, groups)) in ["point", "camera"].iter().zip(self.groups.iter().zip(self.extents())) {
            let pipeline = self.gpu.pipeline(&self.module, &format!("fill{bits}_{half}"));
            self.gpu.submit(&[(&pipeline, group, groups)]);
        }
    }

    fn sums(&self) -> Vec<f32> {
        self.gpu.read(&self.sums, 48 * self.street.segments.len() as u64)
    }
}

/// Largest difference of two lists, relative to their largest entry.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    let largest = a.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / largest
}

/// R2: recompute Jacobians or store them.
fn store(gpu: &Gpu) {
    println!("R2, recompute or store: 1 M observations of 200 k points, tracks of {}", street::TRACK);
    let operator = Operator::new(gpu, Street::new(1_000_000, false), true);
    let observations = operator.street.by_point.len() as f64;
    let mut exact = Vec::new();
    // Bytes an observation: the two orders' index and weight; 2/5 of a point record a point walk and one gathered y (and
    // x) an observation; Jacobians in both orders.
    let shared = 8.0 + 8.0 + 64.0 / 5.0;
    for (form, bytes, more) in [
        ("recomputed", shared + 32.0, 0.0),
        ("stored32", shared + 16.0 + 2.0 * 80.0, 2.0 * 96.0),
        ("stored16", shared + 16.0 + 2.0 * 36.0, 2.0 * 48.0),
    ] {
        if form != "recomputed" {
            operator.fill(&form[6..]);
        }
        let [point, camera] = operator.time(form);
        let sums = operator.sums();
        if exact.is_empty() {
            exact.clone_from(&sums);
        }
        let all = point.wall + camera.wall;
        println!(
            "  {form:10}  point half {:6.1} ms  camera half {:6.1} ms  {:5.1} M observations/s  {:5.1} GB/s of {bytes:.0} \
             bytes an observation, processor {:4.0} ms, {more:.0} bytes more resident, off by {:.0e}",
            1e3 * point.wall,
            1e3 * camera.wall,
            observations / all / 1e6,
            observations * bytes / all / 1e9,
            1e3 * (point.processor + camera.processor),
            apart(&exact, &sums)
        );
    }
}

/// R3: gathers of 32-byte points from chunks of several sizes, neighbours in order or shuffled.
fn gather(gpu: &Gpu) {
    println!("R3, locality of the camera half's gathers (ns an observation)");
    for thousands in [62, 250, 1000, 2000, 4000] {
        let of = |shuffled| {
            let operator = Operator::new(gpu, Street::new(1000 * thousands, shuffled), false);
            let [_, camera] = operator.time("recomputed");
            let observations = operator.street.by_image.len() as f64;
            [camera.wall, camera.processor].map(|seconds| 1e9 * seconds / observations)
        };
        let [ordered, shuffled] = [of(false), of(true)];
        let bytes = 32 * thousands * 1000 / street::TRACK / 1024;
        println!(
            "  chunk of {thousands:4} k observations, {bytes:6} KiB of points: in order {:5.1} (processor {:5.1}), \
             shuffled {:5.1} ({:5.1}), ratio {:.2} ({:.2})",
            ordered[0],
            ordered[1],
            shuffled[0],
            shuffled[1],
            shuffled[0] / ordered[0],
            shuffled[1] / ordered[1]
        );
    }
}

/// R6: what dispatches, submissions and read-backs cost when there is nothing to compute.
fn dispatch(gpu: &Gpu) {
    println!("R6, overheads (smallest of 20)");
    let module = gpu.module(include_str!("empty.wgsl"), "w");
    let mut words = vec![0u32; 4096];
    for (stop, what) in [(0, "one workgroup"), (1, "64 workgroups that return at once")] {
        words[0] = stop;
        let data = gpu.buffer(&words, false);
        let group = gpu.group(&module, &[&data]);
        let pipeline = gpu.pipeline(&module, "empty");
        let groups = if stop == 0 { 1 } else { 64 };
        let many = |count| vec![(&pipeline, &group, groups); count];
        let batch = many(100);
        let hundred = gpu.time(20, || gpu.submit(&batch)).wall;
        let single = many(1);
        let one = gpu.time(20, || gpu.submit(&single)).wall;
        let trial = many(90);
        let step = gpu.time(20, || {
            gpu.submit(&trial);
            gpu.read(&data, 256);
        });
        let step = step.wall;
        println!(
            "  {what}: submit and wait {:.0} µs, dispatch {:.1} µs, 90 dispatches and a read-back of 256 bytes {:.2} ms",
            1e6 * one,
            1e6 * (hundred - one) / 99.0,
            1e3 * step
        );
    }
    let data = gpu.zeroed(1 << 16);
    println!("  read-back alone {:.0} µs", 1e6 * gpu.time(20, || drop(gpu.read(&data, 256))).wall);
}

/// Name and program.
type Experiment = (&'static str, fn(&Gpu));

fn main() -> ExitCode {
    let gpu = match Gpu::open() {
        Ok(gpu) => gpu,
        Err(reason) => {
            eprintln!("no WebGPU device: {reason}");
            return ExitCode::FAILURE;
        }
    };
    println!("on {}", gpu.name);
    let asked = std::env::args().nth(1);
    let experiments: [Experiment; 3] = [("store", store), ("gather", gather), ("dispatch", dispatch)];
    let start = Instant::now();
    for (name, experiment) in experiments {
        if asked.as_deref().is_none_or(|asked| asked == name) {
            experiment(&gpu);
        }
    }
    println!("{:.0} s", start.elapsed().as_secs_f64());
    ExitCode::SUCCESS
}
