// The points' change from the stored values, in a dispatch of its own (see change_camera).

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> points: array<Point>;
@group(0) @binding(2) var<storage, read_write> changes: array<vec4f>;

@compute @workgroup_size(64)
fn change_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p < params.points {
        changes[p] = vec4f(points[p].s - position(points[p]), 0.0);
    }
}
