// Squared norms of the camera columns, one partial sum a segment. The first unused number counts observations.

#import "common/dispatch.wgsl"
#import "bundle/segment_tree.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> segments: array<Segment>;
@group(0) @binding(5) var<storage, read> by_image: array<ByImage>;
@group(0) @binding(6) var<storage, read_write> partials: array<CameraStep>;

@compute @workgroup_size(64)
fn linearize_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = min(linear_group(group, num_groups), params.segments - 1u);
    let segment = segments[g];
    let view = views[segment.image];
    let k = intrinsics[view.camera];
    var sum = no_step();
    for (var o = segment.start + lane; o < segment.end; o += 64u) {
        let seen = by_image[o];
        if seen.weight == 0.0 {
            continue;
        }
        let row = row_of(points[seen.point], view, k, params.cell, image_weights(seen));
        let rx = cross(row.ray, row.px);
        let ry = cross(row.ray, row.py);
        let center = row.px * row.px + row.py * row.py;
        sum.a += vec4f(rx * rx + ry * ry, center.x);
        sum.b += vec4f(center.yz, 1.0, 0.0);
#if depth
        let rz = cross(row.ray, row.pz);
        let center_by_depth = row.pz * row.pz;
        sum.a += vec4f(rz * rz, center_by_depth.x);
        sum.b += vec4f(center_by_depth.yz, 0.0, 0.0);
#endif
        let params = add_units(multiply_units(row.x_params, row.x_params), multiply_units(row.y_params, row.y_params));
        sum.params = add_units(sum.params, params);
    }
    let total = reduce_step(lane, sum);
    if lane == 0u {
        partials[segment.slot] = total;
    }
}
