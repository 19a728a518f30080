// Weights of the robust loss at the accepted state, in both orders of the observations.

#import "common/dispatch.wgsl"
#import "common/loss.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> residuals: array<Residual>;
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
    let counts = (by_point[o].image & OUT) == 0u;
    let place = image_order[o];
    let r = residuals[o].pixel.xy;
    let weight = select(0.0, sqrt(loss_weight(params.loss, params.loss_scale, dot(r, r))), counts);
    by_point[o].weight = weight;
    by_image[place].weight = weight;
#if depth
    let depth = residuals[o].depth;
    let sigmas = depth.w * depth.x;
    let root = sqrt(loss_weight(params.depth_loss, params.depth_loss_scale, sigmas * sigmas));
    let depth_weight = select(0.0, depth.w * root, counts);
    by_point[o].depth_weight = depth_weight;
    by_image[place].depth_weight = depth_weight;
#endif
}
