// Sums the segments of each camera, and inverts its damped 3 × 3 block for the preconditioner.

#import "common/dispatch.wgsl"
#import "positioning/types.wgsl"
#import "positioning/block.wgsl"
#import "positioning/vectors.wgsl"

// A pivot below this part of its diagonal entry is rounding: the diagonal alone preconditions then.
const SMALL_PIVOT = 1e-5;

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read> block_sums: array<vec4f>;
// cameras + 1 offsets, then the segments of each camera.
@group(0) @binding(2) var<storage, read> topology: array<u32>;
@group(0) @binding(3) var<storage, read_write> vectors: array<vec4f>;

@compute @workgroup_size(64)
fn position_factor(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let camera = linear_group(group, num_groups) * 64u + lane;
    if camera >= settings.cameras {
        return;
    }
    var a = vec4f();
    var b = vec4f();
    var c = vec4f();
    for (var k = topology[camera]; k < topology[camera + 1u]; k += 1u) {
        let at = 3u * topology[settings.cameras + 1u + k];
        a += block_sums[at];
        b += block_sums[at + 1u];
        c += block_sums[at + 2u];
    }
    let diagonal = floored(c.yzw);
    let damping = settings.lambda * diagonal;
    let d = vec3f(a.x, a.w, b.y) + damping;
    // LDLᵀ, then the inverse by columns.
    let l10 = a.y / d.x;
    let l20 = a.z / d.x;
    let p1 = d.y - l10 * a.y;
    let s21 = b.x - l10 * a.z;
    let l21 = s21 / p1;
    let p2 = d.z - l20 * a.z - l21 * s21;
    var top = vec3f();
    var bottom = vec3f();
    if d.x > 0.0 && p1 > SMALL_PIVOT * d.y && p2 > SMALL_PIVOT * d.z {
        let u = l10 * l21 - l20;
        bottom = vec3f(1.0 / p1 + l21 * l21 / p2, -l21 / p2, 1.0 / p2);
        top = vec3f(1.0 / d.x + l10 * l10 / p1 + u * u / p2, -l10 / p1 - u * l21 / p2, u / p2);
    } else {
        // The undamped diagonal is never less than the block's own.
        let safe = select(vec3f(), 1.0 / (diagonal + damping), diagonal > vec3f());
        top = vec3f(safe.x, 0.0, 0.0);
        bottom = vec3f(safe.y, 0.0, safe.z);
    }
    vectors[section(RHS, settings.cameras) + camera] = vec4f(b.zw, c.x, 0.0);
    vectors[section(DIAGONAL, settings.cameras) + camera] = vec4f(diagonal, 0.0);
    vectors[section(INVERSE_TOP, settings.cameras) + camera] = vec4f(top, 0.0);
    vectors[section(INVERSE_BOTTOM, settings.cameras) + camera] = vec4f(bottom, 0.0);
}
