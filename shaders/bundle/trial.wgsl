// Residuals at the tried state as exact differences, and what LM decides on. Sums: change of the cost, cost after,
// observations that fall behind their camera, observations that count after; Σ ln s over those. Where the objective is
// truncated, falling behind costs τ, and the cost after is that of what counts alone.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "bundle/cost.wgsl"
#import "bundle/sight.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> changes: array<vec4f>;
@group(0) @binding(5) var<storage, read> tracks: array<u32>;
@group(0) @binding(6) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(7) var<storage, read_write> residuals: array<Residual>;
@group(0) @binding(8) var<storage, read_write> sums: array<Eight>;

@compute @workgroup_size(64)
fn trial(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var sum = vec4f();
    var logarithms = 0.0;
    if p < params.points {
        let point = points[p];
        for (var o = tracks[p]; o < tracks[track_end_at(params.points, p)]; o += 1u) {
            let image = by_point[o].image & IMAGE_MASK;
            let is_out = (by_point[o].image & OUT) != 0u;
            let r = accepted(residuals[o]);
            var after = r;
            if !is_out {
                after = invalid();
                let view = views[image];
                let next = views[image + params.images];
                let change = views[image + 2u * params.images];
                let ray = ray_to(point, view, params.cell);
                let q = rotate(view, ray);
                let moved = changes[p].xyz - vec3f(change.r0.w, change.r1.w, change.r2.w);
                let dq = rotate(change, ray) + rotate(next, moved);
                if is_seen(intrinsics[view.camera + params.cameras], limits_of(image, params.images), q + dq, params.activation) {
                    let k = intrinsics[view.camera];
                    let pixel = project_change(k, intrinsics[view.camera + 2u * params.cameras], q, dq);
                    let dr = add_depth_change(residuals[o], pixel, q.z, dq.z);
                    if has_finite_depth(residuals[o], r + dr) {
                        after = r + dr;
                        sum.x += cost_change(residuals[o], r, dr);
                        sum.w += 1.0;
                        logarithms += log(max(dot(after.xy, after.xy), LEAST_SQUARE));
                    }
                }
                if after.x == INVALID {
                    if params.activation == TRUNCATED {
                        sum.x += params.tau - worth_of(residuals[o], r);
                    }
                    sum.z += 1.0;
                }
            }
            residuals[o] = with_errors(residuals[o], r, after);
            let gone = after.x == INVALID;
            let counted = select(after, r, gone);
            if params.activation != TRUNCATED || !(gone || is_out) {
                sum.y += cost_of(residuals[o], counted);
            }
        }
    }
    let total = reduce_eight(lane, Eight(sum, vec4f(logarithms, 0.0, 0.0, 0.0)));
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
