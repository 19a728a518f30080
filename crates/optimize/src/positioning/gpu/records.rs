//! How plain data becomes the kernels' records, laid out as `shaders/positioning/types.wgsl` declares them.

use crate::positioning::layout::{Layout, Rays};
use crate::positioning::vec3::Vec3;
use crate::reduced::PcgOptions;

/// What is minimised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Stage {
    #[default]
    EqualScales = 0,
    Lud = 1,
    Project = 2,
}

/// What `position_gauge` does, as in `shaders/positioning/gauge.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Gauge {
    /// Leaves positions as they are.
    #[default]
    Keep = 0,
    /// Normalises, and finds the least scale.
    Start = 1,
    /// Normalises, and lets the least scale follow.
    Follow = 2,
}

/// Added to [`Gauge`] where the unit is known.
const METRIC: u32 = 4;

/// The uniform `Params` of a chunk's kernels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Params {
    pub(super) points: u32,
    pub(super) observations: u32,
    pub(super) segments: u32,
    pub(super) first_segment: u32,
    pub(super) first_group: u32,
    pub(super) samples: u32,
}

impl Params {
    pub(super) fn words(&self) -> [u32; 8] {
        [self.points, self.observations, self.segments, self.first_segment, self.first_group, self.samples, 0, 0]
    }
}

/// The uniform `Settings` of all kernels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Settings {
    pub(super) cameras: u32,
    pub(super) point_groups: u32,
    pub(super) samples: u32,
    pub(super) stage: Stage,
    pub(super) lambda: f32,
    pub(super) huber: f32,
    pub(super) huber_pinned: f32,
    /// By stage: scale of free observations; least length of a ray; least scale over the median one.
    pub(super) bound: f32,
    pub(super) delta: f32,
    pub(super) pcg: PcgOptions,
    pub(super) gauge: Gauge,
    pub(super) metric: bool,
}

impl Settings {
    pub(super) fn words(&self) -> [u32; 16] {
        let gauge = self.gauge as u32;
        [
            self.cameras,
            self.point_groups,
            self.samples,
            self.stage as u32,
            self.lambda.to_bits(),
            self.huber.to_bits(),
            self.huber_pinned.to_bits(),
            self.bound.to_bits(),
            self.delta.to_bits(),
            (self.pcg.eta as f32).to_bits(),
            self.pcg.min_iterations as u32,
            self.pcg.max_iterations as u32,
            if self.metric && gauge > 0 { gauge | METRIC } else { gauge },
            0,
            0,
            0,
        ]
    }
}

/// ω by camera: the largest of its observations. Only pins weigh less.
pub(super) fn camera_weights(layout: &Layout, rays: &Rays<f32>) -> Vec<f32> {
    let mut weights = vec![0.0f32; layout.cameras()];
    for (&camera, &weight) in layout.camera.iter().zip(&rays.weight) {
        weights[camera as usize] = weights[camera as usize].max(weight);
    }
    weights
}

/// Directions with what is known of their lengths: 1 / length, 0, or −1 where the observation is left out. A pinned
/// direction is as long as the pin's share of its camera's ω.
pub(super) fn ray_records(layout: &Layout, rays: &Rays<f32>, weights: &[f32]) -> Vec<[f32; 4]> {
    let record = |o: usize| {
        let ([x, y, z], weight, pin) = (rays.direction[o], rays.weight[o], rays.pin[o]);
        let share = if pin > 0.0 { weight / weights[layout.camera[o] as usize] } else { 1.0 };
        if weight > 0.0 { [share * x, share * y, share * z, pin] } else { [x, y, z, -1.0] }
    };
    (0..layout.observations()).map(record).collect()
}

/// `Point` with the tried position at the accepted one.
pub(super) fn point_record([x, y, z]: Vec3<f32>) -> [f32; 8] {
    [x, y, z, 0.0, x, y, z, 0.0]
}
