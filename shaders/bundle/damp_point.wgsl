// Damped blocks R̃ᵀR̃ = RᵀR + λ diag(RᵀR), and the step y₀ each point would take alone.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"
#import "bundle/block.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> points: array<Point>;
@group(0) @binding(2) var<storage, read_write> blocks: array<Block>;

@compute @workgroup_size(64)
fn damp_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p >= params.points {
        return;
    }
    var block = blocks[p];
    block.damped_top = vec4f();
    block.damped_bottom = vec4f();
    var y = vec3f();
    if block.norms.w == 1.0 {
        let root = sqrt(params.lambda * block.norms.xyz);
        var r = Triangle(block.top.xyz, block.bottom.xyz);
        r = fold_row(r, vec3f(root.x, 0.0, 0.0));
        r = fold_row(r, vec3f(0.0, root.y, 0.0));
        r = fold_row(r, vec3f(0.0, 0.0, root.z));
        block.damped_top = vec4f(1.0 / r.top.x, r.top.yz, 0.0);
        block.damped_bottom = vec4f(1.0 / r.bottom.x, r.bottom.y, 1.0 / r.bottom.z, 0.0);
        y = solve_normal(block, block.gradient.xyz);
    }
    blocks[p] = block;
    points[p].s = y;
}
