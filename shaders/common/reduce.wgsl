// Second stage of the sums that decide: many rows to few, which the host adds in f64.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"

const LANES = 64u;

struct ReduceParams {
    // Rows in all, and rows that one workgroup sums.
    count: u32,
    span: u32,
}

@group(0) @binding(0) var<uniform> reduce_params: ReduceParams;
@group(0) @binding(1) var<storage, read> rows: array<Eight>;
@group(0) @binding(2) var<storage, read_write> sums: array<Eight>;

@compute @workgroup_size(64)
fn reduce(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let start = g * reduce_params.span;
    let end = min(start + reduce_params.span, reduce_params.count);
    var sum = Eight(vec4f(), vec4f());
    for (var i = start + lane; i < end; i += 64u) {
        sum = add_eight(sum, rows[i]);
    }
    let total = reduce_eight(lane, sum);
    if lane == 0u && start < reduce_params.count {
        sums[g] = total;
    }
}
