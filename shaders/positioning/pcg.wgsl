// What the two vector kernels of PCG share.

#import "positioning/types.wgsl"
#import "positioning/vectors.wgsl"
#import "common/tree.wgsl"

const LANES = 256u;

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read_write> vectors: array<vec4f>;

fn load(which: u32, camera: u32) -> vec3f {
    return vectors[section(which, settings.cameras) + camera].xyz;
}

fn store(which: u32, camera: u32, value: vec3f) {
    vectors[section(which, settings.cameras) + camera] = vec4f(value, 0.0);
}

// The camera's part of M⁻¹ r.
fn precondition(camera: u32, r: vec3f) -> vec3f {
    let top = load(INVERSE_TOP, camera);
    let bottom = load(INVERSE_BOTTOM, camera);
    return vec3f(
        dot(top, r),
        dot(vec3f(top.y, bottom.xy), r),
        dot(vec3f(top.z, bottom.yz), r),
    );
}
