// Takes a piece's sums from the coarse matrix. One workgroup a block.

#import "common/dispatch.wgsl"
#import "bundle/coarse.wgsl"

@group(0) @binding(0) var<storage, read> coarse_piece: array<u32>;
@group(0) @binding(1) var<storage, read> coarse_blocks: array<CoarseBlock>;
@group(0) @binding(2) var<storage, read> coarse_partials: array<f32>;
@group(0) @binding(3) var<storage, read_write> coarse_matrix: array<f32>;

@compute @workgroup_size(64)
fn coarse_subtract(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = linear_group(group, num_groups);
    if slot >= arrayLength(&coarse_blocks) {
        return;
    }
    let block = coarse_blocks[slot];
    let at = 3u + coarse_piece[1];
    var sum = 0.0;
    for (var s = coarse_piece[2u + block.row]; s < coarse_piece[3u + block.row]; s += 1u) {
        sum += coarse_partials[64u * (coarse_piece[at + SEGMENT_WORDS * s + 4u] + slot - block.first) + lane];
    }
    coarse_matrix[64u * slot + lane] -= sum;
}
