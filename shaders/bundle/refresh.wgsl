// Residuals from scratch, and their cost. An observation without a valid projection at the start never counts; one that
// left on the way keeps its last residual, and so its last cost.

#import "common/dispatch.wgsl"
#import "common/loss.wgsl"
#import "common/tree.wgsl"
#import "bundle/types.wgsl"

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

@compute @workgroup_size(64)
fn refresh(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var cost = 0.0;
    var active_count = 0.0;
    if p < params.points {
        let point = points[p];
        for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
            let image = by_point[o].image;
            var r = residuals[o].xy;
            if (image & OUT) == 0u {
                let view = views[image];
                let q = rotate(view, ray_to(point, view, params.cell));
                let k = intrinsics[view.camera];
                if sees(k, q, params.check_depth) {
                    r = project_residual(k, q, pixels[o]);
                    active_count += 1.0;
                } else {
                    by_point[o].image = image | OUT;
                }
            }
            residuals[o] = vec4f(r, r);
            cost += loss_value(params.loss, params.loss_scale, dot(r, r));
        }
    }
    let total = reduce_eight(lane, Eight(vec4f(0.0, cost, 0.0, active_count), vec4f()));
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
