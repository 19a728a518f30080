// Everything a camera model gives for one ray, so that a test can hold it to the models of the CPU.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

struct CameraProbeParams {
    count: u32,
}

// Residual (2), 1 where the model sees the ray before and after (1), change (2), derivative by the ray (6), by the
// parameters (twice PARAMS).
const ROW = 11u + 2u * PARAMS;

@group(0) @binding(0) var<uniform> camera_probe_params: CameraProbeParams;
// A ray's camera before the step, and its change.
@group(0) @binding(1) var<storage, read> intrinsics: array<Intrinsics>;
// The ray, its change, and a pixel.
@group(0) @binding(2) var<storage, read> rays: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> rows: array<f32>;

fn put3(at: u32, value: vec3f) {
    rows[at] = value.x;
    rows[at + 1u] = value.y;
    rows[at + 2u] = value.z;
}

fn put4(at: u32, value: vec4f) {
    put3(at, value.xyz);
    rows[at + 3u] = value.w;
}

fn put_unit(at: u32, value: Unit) {
    put4(at, value.a);
    put4(at + 4u, value.b);
#if wide
    put4(at + 8u, value.c);
    put4(at + 12u, value.d);
#endif
}

@compute @workgroup_size(64)
fn camera_probe(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = linear_group(group, num_groups) * 64u + lane;
    if i >= camera_probe_params.count {
        return;
    }
    let k = intrinsics[2u * i];
    let dk = intrinsics[2u * i + 1u];
    let after = Intrinsics(add_units(k.params, dk.params), k.kind);
    let q = rays[3u * i].xyz;
    let dq = rays[3u * i + 1u].xyz;
    let at = ROW * i;
    let residual = project_residual(k, q, rays[3u * i + 2u].xy);
    let change = project_change(k, dk, q, dq);
    let both = sees(k, q, 1u) && sees(after, q + dq, 1u);
    put4(at, vec4f(residual, select(0.0, 1.0, both), change.x));
    rows[at + 4u] = change.y;
    let derivative = differentiate(k, q);
    put3(at + 5u, derivative.x_by_q);
    put3(at + 8u, derivative.y_by_q);
    put_unit(at + 11u, derivative.x_by_params);
    put_unit(at + 11u + PARAMS, derivative.y_by_params);
}
