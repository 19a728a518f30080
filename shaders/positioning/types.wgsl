// What the positioning kernels share: records as crates/optimize/src/positioning/gpu/records.rs lays them out.

// A chunk of points.
struct Params {
    points: u32,
    observations: u32,
    segments: u32,
    // Places of its first segment and of its first workgroup of points among those of all chunks.
    first_segment: u32,
    first_group: u32,
    // Its share of the observations that medians are taken of.
    samples: u32,
    padding_a: u32,
    padding_b: u32,
}

// The same for all chunks.
struct Settings {
    cameras: u32,
    // Workgroups of points, and observations that medians are taken of, in all chunks.
    point_groups: u32,
    samples: u32,
    // What is minimised: one of the constants below.
    stage: u32,
    lambda: f32,
    huber: f32,
    huber_pinned: f32,
    // EQUAL_SCALES: scale of free observations. LUD: least length of a ray. PROJECT: least scale over the median one.
    bound: f32,
    // LUD: deviations below this length weigh alike.
    delta: f32,
    eta: f32,
    min_iterations: u32,
    max_iterations: u32,
    // What position_gauge does: one of the constants there.
    gauge: u32,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
}

// ½ Σ ω ρ(‖v − s d‖²), free scales at one value.
const EQUAL_SCALES = 0u;
// Σ ω ‖d − ℓ v‖.
const LUD = 1u;
// ½ Σ ω ρ(‖v − s d‖²), free scales at their best.
const PROJECT = 2u;

struct Point {
    x: vec3f,
    // Its observations' share of the objective.
    cost: f32,
    // A step or a tried position, by kernel.
    s: vec3f,
    padding: f32,
}

// An observation in the points' order.
struct ByPoint {
    camera: u32,
    // As `Row` wants it.
    scale: f32,
}

// An observation in the cameras' order.
struct ByCamera {
    point: u32,
    scale: f32,
    // Its place in the points' order.
    index: u32,
}

// At most 512 observations of one camera.
struct Segment {
    camera: u32,
    start: u32,
    end: u32,
    padding: u32,
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
