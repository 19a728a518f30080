//! The accepted state on the host, a step or a few behind the device: what is left when the device goes.

use super::chunk::Chunk;
use super::layout::Layout;
use super::records::{Intrinsics, Point, View};
use super::resident::Resident;
use crate::gpu::{Device, GpuError, Pending, ReadBack};

/// At most this share of the bytes that the solve moves on the device goes into larger copies: a bound that needs no
/// clock. The way to the host is some 80 times slower than a fast card's own memory, so a copy takes a sixth of the time
/// at worst. An LM iteration moves 60 bytes an observation for each of 10–30 products, a state has 32 bytes a point:
/// every second or third accepted state is kept.
const COPY_SHARE: f64 = 1.0 / 500.0;
/// Copies of at most this size are made after every accepted step: 0.1 ms on any bus.
const SMALL_BYTES: u64 = 1 << 20;

/// Which state a problem was left at when a device failed on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checkpoint {
    /// The LM iteration that accepted it, from 1.
    pub iteration: usize,
    /// Its cost, as the observer was told.
    pub cost: f64,
    /// Damping of that iteration: what to resume with, as `LmOptions::lambda0`.
    pub lambda: f64,
}

/// The accepted state, as the kernels hold it.
#[derive(Debug)]
pub(super) struct Snapshot {
    pub(super) views: Vec<View>,
    pub(super) intrinsics: Vec<Intrinsics>,
    /// By chunk.
    pub(super) points: Vec<Vec<Point>>,
}

/// Staging buffers and what came out of them last.
#[derive(Debug)]
pub(super) struct Checkpoints {
    cameras: ReadBack,
    points: Vec<ReadBack>,
    bytes: u64,
    /// Bytes moved by the solve and not yet spent.
    earned: f64,
    flight: Option<(Checkpoint, Vec<Pending>)>,
    last: Option<(Checkpoint, Snapshot)>,
}

impl Checkpoints {
    pub(super) fn new(device: &Device, layout: &Layout) -> Result<Self, GpuError> {
        let cameras = size_of_val(&layout.views[..]) as u64 + intrinsics_bytes(layout);
        let sizes = || layout.chunks.iter().map(|c| size_of_val(&c.points[..]) as u64);
        Ok(Self {
            cameras: device.read_back("camera checkpoint", cameras)?,
            points: sizes().map(|bytes| device.read_back("point checkpoint", bytes)).collect::<Result<_, _>>()?,
            bytes: cameras + sizes().sum::<u64>(),
            earned: 0.0,
            flight: None,
            last: None,
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Counts what the solve moved.
    pub(super) fn earn(&mut self, bytes: f64) {
        self.earned += bytes;
    }

    /// Whether a copy can be queued: none is on its way, and it would not cost more than its share.
    pub(super) fn is_due(&self) -> bool {
        let cheap = self.bytes <= SMALL_BYTES || self.bytes as f64 <= COPY_SHARE * self.earned;
        self.flight.is_none() && cheap
    }

    /// Queues a copy of the accepted state.
    pub(super) fn start(&mut self, device: &Device, layout: &Layout, resident: &Resident, state: Checkpoint) {
        let mut encoder = device.encoder();
        let views = size_of_val(&layout.views[..]) as u64;
        self.cameras.copy(&mut encoder, &resident.buffers.views, 0, 0, views);
        self.cameras.copy(&mut encoder, &resident.buffers.intrinsics, 0, views, intrinsics_bytes(layout));
        for ((staging, chunk), buffers) in self.points.iter().zip(&layout.chunks).zip(&resident.chunks) {
            staging.copy(&mut encoder, &buffers.points, 0, 0, size_of_val(&chunk.points[..]) as u64);
        }
        device.submit(encoder);
        let all = std::iter::once(&self.cameras).chain(&self.points);
        self.flight = Some((state, all.map(ReadBack::begin).collect()));
        self.earned = 0.0;
    }

    /// Takes in the copy on its way, if it has arrived.
    pub(super) fn harvest(&mut self, layout: &Layout) -> Result<(), GpuError> {
        let Some((state, flight)) = self.flight.take_if(|(_, flight)| flight.iter().all(Pending::has_arrived)) else {
            return Ok(());
        };
        let Some((cameras, points)) = flight.split_first() else { return Ok(()) };
        let views = size_of_val(&layout.views[..]) as u64;
        let (views, intrinsics) = self.cameras.finish(cameras, |staging| {
            let words = staging.values(views, layout.intrinsics.len() * layout.sizes.intrinsics())?;
            Ok((staging.values(0, layout.views.len())?, layout.sizes.unpack(&words)))
        })?;
        let one = |((staging, pending), chunk): ((&ReadBack, &Pending), &Chunk)| {
            staging.finish(pending, |staging| staging.values(0, chunk.points.len()))
        };
        let points = self.points.iter().zip(points).zip(&layout.chunks).map(one).collect::<Result<_, _>>()?;
        self.last = Some((state, Snapshot { views, intrinsics, points }));
        Ok(())
    }

    /// The last copy that arrived.
    pub(super) fn last(&self) -> Option<&(Checkpoint, Snapshot)> {
        self.last.as_ref()
    }
}

fn intrinsics_bytes(layout: &Layout) -> u64 {
    (layout.intrinsics.len() * layout.sizes.intrinsics() * size_of::<u32>()) as u64
}
