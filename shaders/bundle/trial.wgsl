// Residuals at the tried state as exact differences, and what LM decides on. Sums: change of the cost, cost after,
// observations that fall behind their camera, observations that count after.

#import "common/dispatch.wgsl"
#import "common/loss.wgsl"
#import "common/tree.wgsl"
#import "bundle/types.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> changes: array<vec4f>;
@group(0) @binding(5) var<storage, read> tracks: array<u32>;
@group(0) @binding(6) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(7) var<storage, read_write> residuals: array<vec4f>;
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
    if p < params.points {
        let point = points[p];
        for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
            let image = by_point[o].image;
            let r = residuals[o].xy;
            var after = r;
            if (image & OUT) == 0u {
                let view = views[image];
                let next = views[image + params.images];
                let change = views[image + 2u * params.images];
                let ray = ray_to(point, view, params.cell);
                let q = rotate(view, ray);
                let moved = changes[p].xyz - vec3f(change.r0.w, change.r1.w, change.r2.w);
                let dq = rotate(change, ray) + rotate(next, moved);
                if sees(intrinsics[view.camera + params.cameras], q + dq, params.check_depth) {
                    let k = intrinsics[view.camera];
                    let dr = project_change(k, intrinsics[view.camera + 2u * params.cameras], q, dq);
                    after = r + dr;
                    sum.x += loss_difference(params.loss, params.loss_scale, dot(r, r), dot(dr, 2.0 * r + dr));
                    sum.w += 1.0;
                } else {
                    after = vec2f(INVALID);
                    sum.z += 1.0;
                }
            }
            residuals[o] = vec4f(r, after);
            let counted = select(after, r, after.x == INVALID);
            sum.y += loss_value(params.loss, params.loss_scale, dot(counted, counted));
        }
    }
    let total = reduce_eight(lane, Eight(sum, vec4f()));
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
