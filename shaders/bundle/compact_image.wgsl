// Moves the observations of each segment that count before those that do not, by a prefix sum, in their order, and says
// where they end. One workgroup a segment; runs after compact_point.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

const LANES = 64u;
// Observations of a lane: a segment has at most 512.
const SHARE = 8u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> segments: array<Segment>;
@group(0) @binding(2) var<storage, read_write> by_image: array<ByImage>;
@group(0) @binding(3) var<storage, read_write> image_order: array<u32>;

var<workgroup> counts: array<u32, LANES>;

@compute @workgroup_size(64)
fn compact_image(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = min(linear_group(group, num_groups), params.segments - 1u);
    let start = segments[g].start;
    // Segments follow one another; the end of this one may have been moved.
    var end = params.observations;
    if g + 1u < params.segments {
        end = segments[g + 1u].start;
    }
    var records: array<ByImage, SHARE>;
    let first = start + lane * SHARE;
    var own = 0u;
    for (var k = 0u; k < SHARE; k += 1u) {
        if first + k < end {
            records[k] = by_image[first + k];
            own += select(0u, 1u, records[k].weight != 0.0);
        }
    }
    counts[lane] = own;
    // Also keeps the writes below behind the reads above.
    storageBarrier();
    workgroupBarrier();
    var before = 0u;
    var total = 0u;
    for (var k = 0u; k < LANES; k += 1u) {
        before += select(0u, counts[k], k < lane);
        total += counts[k];
    }
    if params.compact == 1u {
        var inside = start + before;
        var outside = start + total + lane * SHARE - before;
        for (var k = 0u; k < SHARE; k += 1u) {
            if first + k < end {
                let counts_here = records[k].weight != 0.0;
                let place = select(outside, inside, counts_here);
                by_image[place] = records[k];
                image_order[records[k].index] = place;
                inside += select(0u, 1u, counts_here);
                outside += select(1u, 0u, counts_here);
            }
        }
        end = start + total;
    }
    if lane == 0u {
        segments[g].end = end;
    }
}
