// The freedom that rays leave: the mean centre goes to the origin and, unless the rays are metric, the median distance
// from camera to point becomes 1. Medians are exact: found digit by digit in the bits of positive floats. One workgroup.

#import "positioning/types.wgsl"
#import "positioning/vectors.wgsl"
#import "common/tree.wgsl"

const LANES = 256u;
// Leave positions as they are.
const KEEP = 0u;
// The start of variable projection: the least scale comes from the median one.
const START = 1u;
// An accepted step: the least scale moves with the unit.
const FOLLOW = 2u;
const METRIC = 4u;

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read> centers: array<vec4f>;
@group(0) @binding(2) var<storage, read> lengths: array<vec2f>;
@group(0) @binding(3) var<storage, read_write> vectors: array<vec4f>;

var<workgroup> bins: array<atomic<u32>, 16>;
// Digits found so far, and how many values with these digits come before the median.
var<workgroup> digits: u32;
var<workgroup> rank: u32;

// The upper median of the values above zero in a column; 0 of none. Must be reached by all lanes.
fn upper_median(lane: u32, column: u32) -> f32 {
    for (var digit = 0u; digit < 8u; digit += 1u) {
        let shift = 28u - 4u * digit;
        if lane < 16u {
            atomicStore(&bins[lane], 0u);
        }
        workgroupBarrier();
        let known = digits;
        for (var k = lane; k < settings.samples; k += LANES) {
            let bits = bitcast<u32>(select(lengths[k].x, lengths[k].y, column == 1u));
            if digit == 0u || (bits >> (shift + 4u)) == known {
                atomicAdd(&bins[(bits >> shift) & 15u], 1u);
            }
        }
        workgroupBarrier();
        if lane == 0u {
            if digit == 0u {
                // Bins from 8 on have the sign's bit.
                var count = 0u;
                for (var bin = 0u; bin < 8u; bin += 1u) {
                    count += atomicLoad(&bins[bin]);
                }
                rank = count / 2u;
                digits = 0u;
            }
            var bin = 0u;
            while bin < 15u && rank >= atomicLoad(&bins[bin]) {
                rank -= atomicLoad(&bins[bin]);
                bin += 1u;
            }
            digits = (digits << 4u) | bin;
        }
        workgroupBarrier();
    }
    return bitcast<f32>(workgroupUniformLoad(&digits));
}

@compute @workgroup_size(256)
fn position_gauge(@builtin(local_invocation_index) lane: u32) {
    var mean = vec3f();
    for (var camera = lane; camera < settings.cameras; camera += LANES) {
        mean += centers[settings.cameras + camera].xyz;
    }
    let total = reduce_eight(lane, Eight(vec4f(mean, 0.0), vec4f()));
    let distance = upper_median(lane, 0u);
    let scale = upper_median(lane, 1u);
    if lane != 0u {
        return;
    }
    if settings.gauge == KEEP {
        vectors[2] = vec4f(0.0, 0.0, 0.0, 1.0);
        return;
    }
    let rescale = (settings.gauge & METRIC) == 0u && distance > 0.0 && is_finite(distance);
    let factor = select(1.0, 1.0 / distance, rescale);
    vectors[2] = vec4f(total.a.xyz / f32(settings.cameras), factor);
    if (settings.gauge & START) != 0u {
        let median_scale = select(1.0, scale / factor, scale > 0.0 && is_finite(scale));
        vectors[3] = vec4f(settings.bound * median_scale, 0.0, 0.0, 0.0);
    } else {
        vectors[3].x = vectors[3].x / factor;
    }
}
