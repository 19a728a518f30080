// Makes the tried state of images and cameras the accepted one.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> views: array<View>;
@group(0) @binding(2) var<storage, read_write> intrinsics: array<Intrinsics>;

@compute @workgroup_size(64)
fn commit_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let unit = linear_group(group, num_groups) * 64u + lane;
    if unit < params.images {
        views[unit] = views[unit + params.images];
    } else if unit < params.images + params.cameras {
        let camera = unit - params.images;
        intrinsics[camera] = intrinsics[camera + params.cameras];
    }
}
