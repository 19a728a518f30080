//! Runs one kernel at a time and compares numbers with both twins.

use super::num::Bounded;
use super::state::State;
use super::trace::Trace;
use crate::bundle::gpu::GpuSystem;

/// Of Σ|terms|, against the f32 twin and against f64.
pub(crate) const TWIN: f64 = 1e-6;
pub(crate) const EXACT: f64 = 1e-5;

/// A system whose kernels are run one by one.
pub(super) struct Bench<'a> {
    pub(super) system: GpuSystem<'a>,
}

impl Bench<'_> {
    /// Runs a kernel, with a trace where they are wanted; the chunks of one problem do not differ.
    pub(super) fn run(&self, kernel: &'static str) {
        let one = self.system.layout.chunks.len() == 1;
        let trace = one.then(|| Trace::begin(&self.system, kernel, "")).flatten();
        self.dispatch(kernel);
        if let Some(trace) = trace {
            trace.end(&self.system, None);
        }
    }

    pub(super) fn dispatch(&self, kernel: &'static str) {
        let mut encoder = self.system.device().encoder();
        self.system.resident.record(&mut encoder, kernel).expect("fits");
        self.system.device().submit(encoder);
    }

    /// Images and cameras.
    pub(super) fn units(&self) -> usize {
        self.system.layout.views.len() + self.system.layout.intrinsics.len()
    }

    pub(super) fn twins(&self) -> (State<f32>, State<Bounded>) {
        (State::download(&self.system), State::download(&self.system))
    }

    pub(super) fn words(&self, buffer: &wgpu::Buffer, count: usize) -> Vec<f32> {
        pollster::block_on(self.system.device().download(buffer, count)).expect("a live device")
    }
}

/// Compares numbers of the device with both twins.
pub(crate) fn compare<'a>(
    what: &str,
    found: impl IntoIterator<Item = &'a f32>,
    twin: impl IntoIterator<Item = f32>,
    exact: impl IntoIterator<Item = Bounded>,
) {
    let (mut worst, mut count) = ([0.0f64; 2], 0);
    let (mut twin, mut exact) = (twin.into_iter(), exact.into_iter());
    for &found in found {
        let (twin, exact) = (twin.next().expect("as many"), exact.next().expect("as many"));
        // Subnormal numbers may be flushed.
        let terms = exact.terms + 1e-30;
        worst[0] = worst[0].max((f64::from(found) - f64::from(twin)).abs() / terms);
        worst[1] = worst[1].max((f64::from(found) - exact.value).abs() / terms);
        assert!(found.is_finite(), "{what}: {found}");
        count += 1;
    }
    assert!(twin.next().is_none() && exact.next().is_none() && count > 0, "{what}: {count}");
    println!("{what}: {count} numbers, worst error {:.1e} of the terms to the twin, {:.1e} to f64", worst[0], worst[1]);
    assert!(worst[0] <= TWIN && worst[1] <= EXACT, "{what}: {worst:?}");
}

pub(crate) fn flat<const W: usize, N: Copy>(rows: &[[N; W]]) -> impl Iterator<Item = N> + '_ {
    rows.iter().flatten().copied()
}

/// RᵀR of a triangle (00 01 02 11 12 22).
pub(crate) fn square(top: [f64; 3], bottom: [f64; 3]) -> [f64; 6] {
    let rows = [top, [0.0, bottom[0], bottom[1]], [0.0, 0.0, bottom[2]]];
    let at = |i: usize, j: usize| rows.iter().map(|r| r[i] * r[j]).sum();
    [at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)]
}
