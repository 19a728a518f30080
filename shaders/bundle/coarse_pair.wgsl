// Sums of EᵀE over the entries of one row of blocks in a piece of points: each entry with the later ones of its point.
// One workgroup a segment, one lane an entry of 8 × 8; no two lanes ever add to the same number.

#import "common/dispatch.wgsl"
#import "bundle/coarse.wgsl"

// Blocks summed at a time: 15 KiB.
const WINDOW = 60u;

@group(0) @binding(0) var<storage, read> coarse_piece: array<u32>;
@group(0) @binding(1) var<storage, read> coarse_entries: array<CoarseEntry>;
@group(0) @binding(2) var<storage, read> coarse_factors: array<f32>;
@group(0) @binding(3) var<storage, read> coarse_blocks: array<CoarseBlock>;
@group(0) @binding(4) var<storage, read_write> coarse_partials: array<f32>;

var<workgroup> sums: array<f32, 3840>;

@compute @workgroup_size(64)
fn coarse_pair(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    if g >= coarse_piece[0] {
        return;
    }
    let at = 3u + coarse_piece[1] + SEGMENT_WORDS * g;
    let order = 3u + coarse_piece[1] + SEGMENT_WORDS * coarse_piece[0];
    let segment = CoarseSegment(
        coarse_piece[at], coarse_piece[at + 1u], coarse_piece[at + 2u], coarse_piece[at + 3u], coarse_piece[at + 4u],
    );
    let row = lane / 8u;
    let column = lane % 8u;
    for (var window = 0u; window < segment.count; window += WINDOW) {
        let size = min(WINDOW, segment.count - window);
        for (var k = 0u; k < size; k += 1u) {
            sums[64u * k + lane] = 0.0;
        }
        for (var i = segment.start; i < segment.end; i += 1u) {
            let e = coarse_piece[order + i];
            let x = vec3f(
                coarse_factors[24u * e + row], coarse_factors[24u * e + 8u + row], coarse_factors[24u * e + 16u + row],
            );
            var k = 0u;
            for (var f = e; f < coarse_entries[e].end; f += 1u) {
                while k < segment.count && coarse_blocks[segment.first + k].column < coarse_entries[f].row {
                    k += 1u;
                }
                if k >= window + size {
                    break;
                }
                if k < window || coarse_blocks[segment.first + k].column != coarse_entries[f].row {
                    continue;
                }
                let y = vec3f(
                    coarse_factors[24u * f + column],
                    coarse_factors[24u * f + 8u + column],
                    coarse_factors[24u * f + 16u + column],
                );
                sums[64u * (k - window) + lane] += dot(x, y);
            }
        }
        for (var k = 0u; k < size; k += 1u) {
            coarse_partials[64u * (segment.out + window + k) + lane] = sums[64u * k + lane];
        }
    }
}
