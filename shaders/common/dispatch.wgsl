// Where an invocation is: dispatches beyond 65 535 workgroups are split over x and y.

fn linear_group(group: vec3u, groups: vec3u) -> u32 {
    return group.y * groups.x + group.x;
}
