// What is kept of the linearisation, in the cameras' order too.

#import "common/dispatch.wgsl"
#import "positioning/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(2) var<storage, read_write> by_camera: array<ByCamera>;

@compute @workgroup_size(64)
fn position_spread(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let o = linear_group(group, num_groups) * 64u + lane;
    if o < params.observations {
        by_camera[o].scale = by_point[by_camera[o].index].scale;
    }
}
