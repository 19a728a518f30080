// Tried centres, and how far they moved. One workgroup.

#import "positioning/types.wgsl"
#import "positioning/vectors.wgsl"
#import "common/tree.wgsl"

const LANES = 256u;

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read_write> centers: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> vectors: array<vec4f>;

var<workgroup> largest: array<vec3f, LANES>;

fn largest_of(v: vec3f) -> f32 {
    let size = abs(v);
    return max(size.x, max(size.y, size.z));
}

@compute @workgroup_size(256)
fn position_step_camera(@builtin(local_invocation_index) lane: u32) {
    var found = vec3f();
    for (var camera = lane; camera < settings.cameras; camera += LANES) {
        let x = vectors[section(X, settings.cameras) + camera].xyz;
        let diagonal = vectors[section(DIAGONAL, settings.cameras) + camera].xyz;
        let before = centers[camera];
        let after = vec4f(before.xyz + x, before.w);
        centers[settings.cameras + camera] = after;
        found = max(found, vec3f(largest_of(sqrt(diagonal) * x), largest_of(x), largest_of(after.xyz)));
    }
    largest[lane] = found;
    for (var stride = LANES / 2u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            let x = largest[lane];
            let y = largest[lane + stride];
            largest[lane] = max(x, y);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        vectors[1] = vec4f(vectors[1].x, largest[0]);
    }
}
