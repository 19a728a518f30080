@compute @workgroup_size(64)
fn fillBITS_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = point_of(group, groups, lane);
    if p >= params.points {
        return;
    }
    for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
        storeBITS(o, row_of(points[p].x.xyz, cameras[by_point[o].other], by_point[o].weight));
    }
}

@compute @workgroup_size(64)
fn fillBITS_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let segment = segments[min(group.y * groups.x + group.x, params.segments - 1u)];
    for (var o = segment.y + lane; o < segment.z; o += 64u) {
        storeBITS(o, row_of(points[by_image[o].other].x.xyz, cameras[segment.x], by_image[o].weight));
    }
}
