// What the bundle kernels share: records as crates/optimize/src/bundle/gpu/records.rs lays them out.

#if wide
#import "common/camera/models.wgsl"
#else
#import "common/perspective.wgsl"
#endif
#import "bundle/observation.wgsl"

struct Params {
    // Of the chunk where a kernel works on one, else of all.
    points: u32,
    observations: u32,
    images: u32,
    cameras: u32,
    // As points.
    segments: u32,
    // Size of a lattice cell, a power of two.
    cell: f32,
    loss: u32,
    loss_scale: f32,
    lambda: f32,
    // How observations come and go: see sight.wgsl.
    activation: u32,
    fixed_points: u32,
    eta: f32,
    min_iterations: u32,
    max_iterations: u32,
    // Rows of sums over points; as points.
    point_groups: u32,
    big_cameras: u32,
    // What an observation outside the set is charged.
    tau: f32,
    // Flags of a refresh: see sight.wgsl.
    refresh_flags: u32,
    // 1 where every point that misses an observation is triangulated again, not only those that miss most.
    revive_all: u32,
    // 1 where observations that count are moved before those that do not.
    compact: u32,
    // Of the depth row, see observation.wgsl.
    depth_loss: u32,
    depth_loss_scale: f32,
}

// Three blocks of images follow one another: accepted state, tried state, change between them. A fourth holds limits: see
// sight.wgsl.
struct View {
    // Rows of cam_from_world, with the centre's offset inside its cell as fourth column.
    r0: vec4f,
    r1: vec4f,
    r2: vec4f,
    // Lattice cell of the centre, camera of the image.
    cell: vec3i,
    camera: u32,
}

// Gaussian beliefs about a camera's parameters: means, and inverse variances, 0 where there is none.
struct Prior {
    mean: Unit,
    information: Unit,
}

struct Point {
    x: f32,
    y: f32,
    z: f32,
    // Lattice cell, 10 bits an axis.
    cell: u32,
    // A step or a tried position, by kernel.
    s: vec3f,
    padding: f32,
}

// At most 512 observations of one image in one chunk of points.
struct Segment {
    image: u32,
    start: u32,
    end: u32,
    // Where its sums go: an image's follow one another, chunk by chunk.
    slot: u32,
}

const OUT = 0x80000000u;
const HIDDEN = 0x40000000u;
const IMAGE_MASK = 0x3fffffffu;
// The mark of a tried residual without a valid projection: no pixel is that far.
const INVALID = 1e30;
// Depths nearer to zero than this have no projection in f32.
const MIN_DEPTH = 1e-20;

fn has_projection(activation: u32, z: f32) -> bool {
    return select(abs(z) > MIN_DEPTH, z > MIN_DEPTH, activation != 0u);
}

// Whether a camera has a pixel for a point in its frame.
fn sees(k: Intrinsics, q: vec3f, activation: u32) -> bool {
#if wide
    if k.kind.y == EQUIRECTANGULAR {
        return dot(q, q) >= TINY;
    }
    return has_projection(activation, q.z) && is_in_domain(k, q.xy / q.z);
#else
    return has_projection(activation, q.z);
#endif
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn position(p: Point) -> vec3f {
    return vec3f(p.x, p.y, p.z);
}

fn point_cell(p: Point) -> vec3i {
    return vec3i(vec3u(p.cell, p.cell >> 10u, p.cell >> 20u) & vec3u(1023u));
}

// Behind the offsets of tracks, where the observations of each end that count: all of them, or the first ones after
// compaction.
fn track_end_at(points: u32, p: u32) -> u32 {
    return points + 1u + p;
}

// X − C in the world frame: cells are subtracted as integers, which nothing can round or reorder
// (source: solver.md §1.3 c).
fn ray_to(p: Point, view: View, cell: f32) -> vec3f {
    let center = vec3f(view.r0.w, view.r1.w, view.r2.w);
    return cell * vec3f(point_cell(p) - view.cell) + (position(p) - center);
}

fn rotate(view: View, v: vec3f) -> vec3f {
    return vec3f(dot(view.r0.xyz, v), dot(view.r1.xyz, v), dot(view.r2.xyz, v));
}
