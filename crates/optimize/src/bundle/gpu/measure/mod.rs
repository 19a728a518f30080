//! How fast the operator and whole steps are on a device, in figures that compare between devices: what
//! `cargo xtask bench gpu` prints (source: `solver.md` §6).

use crate::bundle::Problem;
use crate::bundle::gpu::{Counters, GpuSystem, ResidentBytes};
use crate::bundle::options::Options;
use crate::error::OptimizeError;
use crate::gpu::kernels::STREAM_READ;
use crate::gpu::{Device, GpuError, Pipelines};
use crate::lm::{LmOptions, LmReport, System, minimize};

/// Work queued between two waits: bounds the time of a submission, and hides the host's part.
const BATCH: usize = 8;
/// Bytes of the stream: far beyond any cache, and one binding under WebGPU's default limits.
const STREAM_BYTES: u64 = 128 << 20;
/// Bytes that one workgroup of the stream kernel reads.
const STREAM_GROUP_BYTES: u64 = 256 * 16 * 16;
/// Damping of the measured operator; it takes the same time at any.
const LAMBDA: f64 = 1e-4;

/// How time is taken.
pub struct Timing<'a> {
    /// Seconds since any fixed moment; a browser and a native program have different clocks.
    pub clock: &'a dyn Fn() -> f64,
    /// Use the device's timestamps where it has them; without them the wall is the clock.
    pub timestamps: bool,
    /// Measure at least this long.
    pub min_seconds: f64,
}

/// The time of something that was done many times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeated {
    /// Of one time, the waits of the host left out where there are timestamps.
    pub seconds: f64,
    /// How many times.
    pub times: usize,
    /// Whether the device's own clock was read.
    pub by_timestamps: bool,
}

/// The reduced operator of a problem: the two product kernels over all observations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Operator {
    /// One application.
    pub application: Repeated,
    /// Bytes that the model of `solver.md` §6 counts for it: 48 an observation, 56 a point, 216 an image.
    pub model_bytes: u64,
}

/// Some steps of a solve.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps {
    /// What the loop reports, after one step to warm up.
    pub report: LmReport,
    /// Wall time without making the problem resident and without writing it back.
    pub seconds: f64,
    /// What the device was asked to do in that time.
    pub counters: Counters,
    /// What the problem occupies.
    pub resident_bytes: ResidentBytes,
}

impl Steps {
    /// Share of the time that was spent outside the two product kernels, if the operator was rightly measured.
    pub fn share_outside(&self, operator: &Operator) -> f64 {
        let inside = self.report.inner_iterations as f64 * operator.application.seconds;
        (1.0 - inside / self.seconds).max(0.0)
    }
}

/// Bytes a second of a kernel that reads a large buffer once and does nothing else.
///
/// # Errors
/// [`GpuError`] where the device fails.
pub async fn stream_bytes_per_second(device: &Device, timing: &Timing<'_>) -> Result<f64, GpuError> {
    let bytes = STREAM_BYTES.min(device.max_binding_bytes());
    let groups = bytes.div_ceil(STREAM_GROUP_BYTES);
    let params = device.uniform("stream params", &[(bytes / 16) as u32, 0, 0, 0])?;
    let stream = device.zeroed("stream", bytes)?;
    let sums = device.zeroed("stream sums", groups * 16)?;
    let pipelines = Pipelines::new(device, &[STREAM_READ])?;
    let bound = pipelines.bind(device, &STREAM_READ, &[&params, &stream, &sums])?;
    let queue = |count: usize| {
        let mut encoder = device.encoder();
        (0..count).try_for_each(|_| bound.dispatch(&mut encoder, groups))?;
        device.submit(encoder);
        Ok(())
    };
    let read = repeated(device, timing, queue, || device.download::<u32>(&sums, 1)).await?;
    Ok(bytes as f64 / read.seconds)
}

/// The reduced operator at a problem's start.
///
/// # Errors
/// [`OptimizeError`] for a problem that the device cannot hold, or where it fails.
pub async fn operator(
    device: &Device,
    problem: &Problem,
    options: &Options,
    timing: &Timing<'_>,
) -> Result<Operator, OptimizeError> {
    let mut system = GpuSystem::new(device, problem, options)?;
    system.refresh(&mut ()).await;
    system.linearize(&mut ()).await;
    // PCG at its start: the kernels return at once when it is done.
    system.queue_start(LAMBDA, &mut ()).await?;
    device.check()?;
    let system = &system;
    let queue = |count: usize| {
        let mut encoder = device.encoder();
        for _ in 0..count {
            system.resident.record_by_chunk(&mut encoder, &["product_point", "product_camera"])?;
        }
        device.submit(encoder);
        Ok(())
    };
    let wait = || device.download::<u32>(&system.resident.buffers.vectors, 1);
    let application = repeated(device, timing, queue, wait).await?;
    let [observations, points, images] =
        [problem.observation_px.len(), problem.points.len(), problem.cam_from_world.len()].map(|n| n as u64);
    Ok(Operator { application, model_bytes: 48 * observations + 56 * points + 216 * images })
}

/// Steps of a solve after its first, at most `options.lm.max_iterations`. Drivers compile kernels when they first run, so
/// the first step says nothing.
///
/// # Errors
/// [`OptimizeError`] for a problem that the device cannot hold, or where it fails.
pub async fn steps(
    device: &Device,
    problem: &Problem,
    options: &Options,
    timing: &Timing<'_>,
) -> Result<Steps, OptimizeError> {
    let mut system = GpuSystem::new(device, problem, options)?;
    let first = LmOptions { max_iterations: 1, ..options.lm };
    minimize(&mut system, &first, &mut ()).await;
    let (before, start) = (system.counters(), (timing.clock)());
    let report = minimize(&mut system, &options.lm, &mut ()).await;
    device.check()?;
    let seconds = (timing.clock)() - start;
    let counters = system.counters() - before;
    Ok(Steps { report, seconds, counters, resident_bytes: system.resident_bytes() })
}

/// Queues work again and again for as long as asked, after once to warm up.
async fn repeated<T, W>(
    device: &Device,
    timing: &Timing<'_>,
    queue: impl Fn(usize) -> Result<(), GpuError>,
    wait: impl Fn() -> W,
) -> Result<Repeated, GpuError>
where
    W: Future<Output = Result<T, GpuError>>,
{
    queue(1)?;
    wait().await?;
    if timing.timestamps {
        device.start_timing();
    }
    let start = (timing.clock)();
    let mut times = 0;
    let mut wall = 0.0;
    while wall < timing.min_seconds || times == 0 {
        queue(BATCH)?;
        wait().await?;
        times += BATCH;
        wall = (timing.clock)() - start;
    }
    let kernels = device.finish_timing().await?;
    let on_device: f64 = kernels.iter().map(|k| k.seconds).sum();
    // A driver may offer timestamps and leave them at zero.
    let by_timestamps = on_device > 0.0;
    let seconds = if by_timestamps { on_device } else { wall } / times as f64;
    Ok(Repeated { seconds, times, by_timestamps })
}

#[cfg(test)]
mod tests;
