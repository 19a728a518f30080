// Writes each workgroup's linear index at that index.

#import "common/dispatch.wgsl"

struct ProbeParams {
    count: u32,
}

@group(0) @binding(0) var<uniform> probe_params: ProbeParams;
@group(0) @binding(1) var<storage, read_write> groups: array<u32>;

@compute @workgroup_size(64)
fn probe(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    if lane == 63u && g < probe_params.count {
        groups[g] += g + 1u;
    }
}
