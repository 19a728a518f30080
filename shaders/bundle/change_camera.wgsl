// The change from the accepted to the tried state, from the stored values of both, so that their rounding is part of it.
// A dispatch of its own: in one kernel a compiler may cancel (x + δ) − x (source: solver.md §1.3 d).

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> views: array<View>;
@group(0) @binding(2) var<storage, read_write> intrinsics: array<Intrinsics>;

@compute @workgroup_size(64)
fn change_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let unit = linear_group(group, num_groups) * 64u + lane;
    if unit < params.images {
        let before = views[unit];
        let after = views[unit + params.images];
        let cells = params.cell * vec3f(after.cell - before.cell);
        views[unit + 2u * params.images] = View(
            after.r0 - before.r0 + vec4f(0.0, 0.0, 0.0, cells.x),
            after.r1 - before.r1 + vec4f(0.0, 0.0, 0.0, cells.y),
            after.r2 - before.r2 + vec4f(0.0, 0.0, 0.0, cells.z),
            after.cell,
            after.camera,
        );
    } else if unit < params.images + params.cameras {
        let camera = unit - params.images;
        let before = intrinsics[camera];
        let after = intrinsics[camera + params.cameras];
        intrinsics[camera + 2u * params.cameras] =
            Intrinsics(minus_units(after.params, before.params), before.kind);
    }
}
