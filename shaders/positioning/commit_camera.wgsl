// Accepts the tried centres, in the gauge that position_gauge found.

#import "common/dispatch.wgsl"
#import "positioning/types.wgsl"

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read_write> centers: array<vec4f>;
@group(0) @binding(2) var<storage, read> vectors: array<vec4f>;

@compute @workgroup_size(64)
fn position_commit_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let camera = linear_group(group, num_groups) * 64u + lane;
    if camera < settings.cameras {
        let tried = centers[settings.cameras + camera];
        let gauge = vectors[2];
        centers[camera] = vec4f((tried.xyz - gauge.xyz) * gauge.w, tried.w);
    }
}
