// What an image can see, and which observations count: flags of the points' order (source: solver.md §5.4).

#import "bundle/types.wgsl"

// params.activation
const ALL = 0u;
const VALID_AT_START = 1u;
const TRUNCATED = 2u;
// params.refresh_flags: the set is decided anew; residuals from scratch.
const FIRST_PASS = 1u;
const FROM_SCRATCH = 2u;
// An observation outside returns below this share of τ, as on the CPU.
const RETURN_SHARE = 0.8;
// Squared residuals below this are as good as none, px².
const LEAST_SQUARE = 1e-12;

// Behind accepted, tried and change, the views hold each image's limits: least depth, left, top, right; bottom.
fn limits_of(image: u32, images: u32) -> View {
    return views[image + 3u * images];
}

fn is_seen(k: Intrinsics, limits: View, q: vec3f, activation: u32) -> bool {
    return sees(k, q, activation) && (activation != TRUNCATED || q.z > limits.r0.x);
}

fn is_inside(limits: View, pixel: vec2f) -> bool {
    return all(pixel >= limits.r0.yz) && all(pixel <= vec2f(limits.r0.w, limits.r1.x));
}
