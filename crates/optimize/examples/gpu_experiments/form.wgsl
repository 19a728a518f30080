@compute @workgroup_size(64)
fn NAME_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = point_of(group, groups, lane);
    if p >= params.points {
        return;
    }
    let x = points[p].x.xyz;
    var gradient = vec3f();
    for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
        let camera = cameras[by_point[o].other];
        let row = LOAD_POINT;
        let v = camera_product(row, camera);
        gradient += row.px * v.x + row.py * v.y;
    }
    // Any solve with a resident 3 × 3 block costs the same in all forms.
    points[p].y = vec4f(1e-6 * gradient, 0.0);
}

@compute @workgroup_size(64)
fn NAME_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = min(group.y * groups.x + group.x, params.segments - 1u);
    let segment = segments[g];
    let camera = cameras[segment.x];
    var sum = array<vec4f, 3>();
    for (var o = segment.y + lane; o < segment.z; o += 64u) {
        let p = by_image[o].other;
        let row = LOAD_CAMERA;
        let y = points[p].y.xyz;
        let v = camera_product(row, camera) - vec2f(dot(row.px, y), dot(row.py, y));
        sum[0] += vec4f(row.rotation_x * v.x + row.rotation_y * v.y, dot(v, v));
        sum[1] -= vec4f(row.px * v.x + row.py * v.y, 0.0);
        sum[2] += vec4f(row.intrinsics_x * v.x + row.intrinsics_y * v.y, 0.0);
    }
    let total = reduce(lane, sum);
    if lane == 0u {
        sums[g] = total;
    }
}
