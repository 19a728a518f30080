// Residuals at the accepted state, which observations count there, and their cost. Without a truncated objective an
// observation without a valid projection at the start never counts, and one that left on the way keeps its last residual,
// and so its last cost. With one it leaves at τ, and returns inside its frustum. Sums: nothing, cost, nothing, those that
// count; Σ ln s over them.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "bundle/cost.wgsl"
#import "bundle/sight.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read_write> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> pixels: array<vec2f>;
@group(0) @binding(7) var<storage, read_write> residuals: array<Residual>;
@group(0) @binding(8) var<storage, read_write> sums: array<Eight>;

// The residual of an observation; INVALID where there is none.
fn errors_of(o: u32, point: Point, image: u32) -> Errors {
    let view = views[image];
    let q = rotate(view, ray_to(point, view, params.cell));
    let k = intrinsics[view.camera];
    if is_seen(k, limits_of(image, params.images), q, params.activation) {
        let e = add_depth_error(residuals[o], project_residual(k, q, pixels[o]), q.z);
        if has_finite_depth(residuals[o], e) {
            return e;
        }
    }
    return invalid();
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
            var r = accepted(residuals[o]);
            var counts = was_active && ((flags & HIDDEN) == 0u || params.activation == ALL);
            if params.activation == TRUNCATED {
                if !was_active || (params.refresh_flags & (FIRST_PASS | FROM_SCRATCH)) != 0u {
                    r = errors_of(o, point, image);
                }
                let worth = worth_of(residuals[o], r);
                let limit = params.tau * select(1.0, RETURN_SHARE, !was_active && (params.refresh_flags & FIRST_PASS) == 0u);
                let stays = was_active && (params.refresh_flags & FIRST_PASS) == 0u;
                let enters = stays || is_inside(limits_of(image, params.images), pixels[o] + r.xy);
                counts = r.x != INVALID && worth < limit && enters && (flags & HIDDEN) == 0u;
                cost += select(depth_bound(residuals[o]), cost_of(residuals[o], r), counts);
            } else {
                if counts {
                    let now = errors_of(o, point, image);
                    counts = now.x != INVALID;
                    r = select(r, now, counts);
                }
                cost += cost_of(residuals[o], r);
            }
            by_point[o].image = image | (flags & HIDDEN) | select(OUT, 0u, counts);
            residuals[o] = with_errors(residuals[o], r, r);
            if counts {
                active_count += 1.0;
                logarithms += log(max(dot(r.xy, r.xy), LEAST_SQUARE));
            }
        }
    }
    let total = reduce_eight(lane, Eight(vec4f(0.0, cost, 0.0, active_count), vec4f(logarithms, 0.0, 0.0, 0.0)));
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
