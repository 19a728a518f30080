// Records of an observation, and the numbers it has a row each of: its pixel's two and, in the variant `depth`, its inverse
// depth's (source: solver.md §1.1). An observation whose depth is unknown has the same records and the weight 0.

// An observation in the points' order.
struct ByPoint {
    // Image, with OUT set where the observation does not count, HIDDEN where it is occluded.
    image: u32,
    // Root of the weight of its pixel.
    weight: f32,
#if depth
    // Root of the weight of its inverse depth, whitening included.
    depth_weight: f32,
#endif
}

// An observation in the images' order.
struct ByImage {
    point: u32,
    weight: f32,
    // Its place in the points' order.
    index: u32,
#if depth
    depth_weight: f32,
#else
    padding: u32,
#endif
}

struct Residual {
    // At the accepted and at the tried state, px.
    pixel: vec4f,
#if depth
    // Of the inverse depth at both states, not whitened; then what was measured and its weight 1/σ, 0 where nothing was.
    depth: vec4f,
#endif
}

#if depth
// Pixel, px, and inverse depth, 1 / world unit.
alias Errors = vec3f;
// Roots of the weights of both.
alias Weights = vec2f;

const X_ERROR = vec3f(1.0, 0.0, 0.0);
const Y_ERROR = vec3f(0.0, 1.0, 0.0);
const DEPTH_ERROR = vec3f(0.0, 0.0, 1.0);
// Inverse depths this many σ off cost what infinity would; squares of more are not finite. As in records.rs.
const MAX_DEPTH_SIGMAS = 1e15;

// Where there is no valid projection.
fn invalid() -> Errors {
    return vec3f(INVALID, INVALID, 0.0);
}

fn accepted(r: Residual) -> Errors {
    return vec3f(r.pixel.xy, r.depth.x);
}

fn tried(r: Residual) -> Errors {
    return vec3f(r.pixel.zw, r.depth.y);
}

fn with_errors(r: Residual, now: Errors, next: Errors) -> Residual {
    return Residual(vec4f(now.xy, next.xy), vec4f(now.z, next.z, r.depth.zw));
}

// With that of the depth z.
fn add_depth_error(r: Residual, pixel: vec2f, z: f32) -> Errors {
    return vec3f(pixel, select(0.0, 1.0 / z - r.depth.z, r.depth.w > 0.0));
}

// With that of a depth that changes from z to z + dz, in proportion to the change (source: solver.md §1.3 d).
fn add_depth_change(r: Residual, pixel: vec2f, z: f32, dz: f32) -> Errors {
    return vec3f(pixel, select(0.0, -dz / (z * (z + dz)), r.depth.w > 0.0));
}

fn has_finite_depth(r: Residual, e: Errors) -> bool {
    return abs(r.depth.w * e.z) <= MAX_DEPTH_SIGMAS;
}

fn point_weights(o: ByPoint) -> Weights {
    return vec2f(o.weight, o.depth_weight);
}

fn image_weights(o: ByImage) -> Weights {
    return vec2f(o.weight, o.depth_weight);
}
#else
alias Errors = vec2f;
alias Weights = f32;

const X_ERROR = vec2f(1.0, 0.0);
const Y_ERROR = vec2f(0.0, 1.0);

fn invalid() -> Errors {
    return vec2f(INVALID);
}

fn accepted(r: Residual) -> Errors {
    return r.pixel.xy;
}

fn tried(r: Residual) -> Errors {
    return r.pixel.zw;
}

fn with_errors(r: Residual, now: Errors, next: Errors) -> Residual {
    return Residual(vec4f(now, next));
}

fn add_depth_error(r: Residual, pixel: vec2f, z: f32) -> Errors {
    return pixel;
}

fn add_depth_change(r: Residual, pixel: vec2f, z: f32, dz: f32) -> Errors {
    return pixel;
}

fn has_finite_depth(r: Residual, e: Errors) -> bool {
    return true;
}

fn point_weights(o: ByPoint) -> Weights {
    return o.weight;
}

fn image_weights(o: ByImage) -> Weights {
    return o.weight;
}
#endif
