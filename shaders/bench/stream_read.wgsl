// Reads a buffer once, as fast as the device can: the yardstick of `cargo xtask bench gpu`.

#import "common/dispatch.wgsl"

const LANES = 256u;
// Reads of one invocation, a workgroup's side by side each time.
const READS = 16u;

// x: vec4f in the stream.
@group(0) @binding(0) var<uniform> stream_params: vec4u;
@group(0) @binding(1) var<storage, read> stream: array<vec4f>;
// One sum a workgroup: without a result the compiler would drop the reads.
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;

var<workgroup> lanes: array<vec4f, LANES>;

@compute @workgroup_size(256)
fn stream_read(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let start = g * LANES * READS + lane;
    var sum = vec4f();
    for (var i = 0u; i < READS; i += 1u) {
        let at = start + i * LANES;
        if at < stream_params.x {
            sum += stream[at];
        }
    }
    lanes[lane] = sum;
    for (var stride = LANES / 2u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            lanes[lane] = lanes[lane] + lanes[lane + stride];
        }
    }
    if lane == 0u && g * LANES * READS < stream_params.x {
        sums[g] = lanes[0];
    }
}
