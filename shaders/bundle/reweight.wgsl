// Weights of the robust loss at the accepted state, in both orders of the observations.

#import "common/dispatch.wgsl"
#import "common/loss.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> residuals: array<vec4f>;
@group(0) @binding(2) var<storage, read> image_order: array<u32>;
@group(0) @binding(3) var<storage, read_write> by_point: array<ByPoint>;
@group(0) @binding(4) var<storage, read_write> by_image: array<ByImage>;

@compute @workgroup_size(64)
fn reweight(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let o = linear_group(group, num_groups) * 64u + lane;
    if o >= params.observations {
        return;
    }
    let r = residuals[o].xy;
    var weight = 0.0;
    if (by_point[o].image & OUT) == 0u {
        weight = sqrt(loss_weight(params.loss, params.loss_scale, dot(r, r)));
    }
    by_point[o].weight = weight;
    by_image[image_order[o]].weight = weight;
}
