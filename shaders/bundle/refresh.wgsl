// Residuals at the accepted state, which observations count there, and their cost. Without a truncated objective an
// observation without a valid projection at the start never counts, and one that left on the way keeps its last residual,
// and so its last cost. With one it leaves at τ, and returns inside its frustum. Sums: nothing, cost, nothing, those that
// count; Σ ln s over them.

#import "common/dispatch.wgsl"
#import "common/loss.wgsl"
#import "common/tree.wgsl"
#import "bundle/sight.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read_write> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> pixels: array<vec2f>;
@group(0) @binding(7) var<storage, read_write> residuals: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> sums: array<Eight>;

// The residual; INVALID where there is none.
fn residual_of(point: Point, image: u32, pixel: vec2f) -> vec2f {
    let view = views[image];
    let q = rotate(view, ray_to(point, view, params.cell));
    let k = intrinsics[view.camera];
    if is_seen(k, limits_of(image, params.images), q, params.activation) {
        return project_residual(k, q, pixel);
    }
    return vec2f(INVALID);
}

@compute @workgroup_size(64)
fn refresh(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var cost = 0.0;
    var logarithms = 0.0;
    var active_count = 0.0;
    if p < params.points {
        let point = points[p];
        for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
            let flags = by_point[o].image & ~IMAGE_MASK;
            let image = by_point[o].image & IMAGE_MASK;
            let was_active = (flags & OUT) == 0u;
            var r = residuals[o].xy;
            var counts = was_active && ((flags & HIDDEN) == 0u || params.activation == ALL);
            if params.activation == TRUNCATED {
                if !was_active || (params.refresh_flags & (FIRST_PASS | FROM_SCRATCH)) != 0u {
                    r = residual_of(point, image, pixels[o]);
                }
                let rho = loss_value(params.loss, params.loss_scale, dot(r, r));
                let limit = params.tau * select(1.0, RETURN_SHARE, !was_active && (params.refresh_flags & FIRST_PASS) == 0u);
                let stays = was_active && (params.refresh_flags & FIRST_PASS) == 0u;
                let enters = stays || is_inside(limits_of(image, params.images), pixels[o] + r);
                counts = r.x != INVALID && rho < limit && enters && (flags & HIDDEN) == 0u;
                cost += select(0.0, rho, counts);
            } else {
                if counts {
                    let now = residual_of(point, image, pixels[o]);
                    counts = now.x != INVALID;
                    r = select(r, now, counts);
                }
                cost += loss_value(params.loss, params.loss_scale, dot(r, r));
            }
            by_point[o].image = image | (flags & HIDDEN) | select(OUT, 0u, counts);
            residuals[o] = vec4f(r, r);
            if counts {
                active_count += 1.0;
                logarithms += log(max(dot(r, r), LEAST_SQUARE));
            }
        }
    }
    let total = reduce_eight(lane, Eight(vec4f(0.0, cost, 0.0, active_count), vec4f(logarithms, 0.0, 0.0, 0.0)));
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
