// Accepts the tried points, in the gauge that position_gauge found.

#import "common/dispatch.wgsl"
#import "positioning/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> points: array<Point>;
@group(0) @binding(2) var<storage, read> vectors: array<vec4f>;

@compute @workgroup_size(64)
fn position_commit_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p < params.points {
        let gauge = vectors[2];
        points[p].x = (points[p].s - gauge.xyz) * gauge.w;
    }
}
