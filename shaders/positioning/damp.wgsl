// Damped blocks R̃ᵀR̃ = RᵀR + λD, and the solution y₀ of each for the point's gradient.

#import "common/dispatch.wgsl"
#import "positioning/types.wgsl"
#import "positioning/block.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> settings: Settings;
@group(0) @binding(2) var<storage, read_write> points: array<Point>;
@group(0) @binding(3) var<storage, read_write> blocks: array<PointBlock>;

@compute @workgroup_size(64)
fn position_damp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p >= params.points {
        return;
    }
    var block = blocks[p];
    let root = sqrt(settings.lambda * damping_diagonal(block));
    let r = inverted_diagonal(fold_identity(Triangle(block.top.xyz, block.bottom.xyz), root));
    block.damped_top = vec4f(r.top, block.damped_top.w);
    block.damped_bottom = vec4f(r.bottom, 0.0);
    blocks[p] = block;
    points[p].s = solve_block(block, block_gradient(block));
}
