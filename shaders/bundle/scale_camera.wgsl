// Column scales 1/√diag of the camera unknowns, priors included; 0 takes an unknown out of the system: constant ones, and
// those of an image with too few observations that no prior holds. And the priors' part of the system in that scale.

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/topology.wgsl"
#import "bundle/vectors.wgsl"

// As on the CPU: fewer observations do not fix a pose.
const MIN_OBSERVATIONS = 6.0;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> partials: array<CameraStep>;
@group(0) @binding(2) var<storage, read> topology: array<u32>;
// Two vec4f an image and a camera: 1 where the unknown may move.
@group(0) @binding(3) var<storage, read> freedom: array<vec4f>;
@group(0) @binding(4) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(5) var<storage, read> priors: array<Prior>;
@group(0) @binding(6) var<storage, read_write> vectors: array<vec4f>;

fn inverse_root(d: vec4f) -> vec4f {
    return select(vec4f(), inverseSqrt(max(d, vec4f(1e-30))), d > vec4f(1e-30));
}

@compute @workgroup_size(64)
fn scale_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let unit = linear_group(group, num_groups) * 64u + lane;
    let units = params.images + params.cameras;
    if unit >= units {
        return;
    }
    var a = vec4f();
    var b = vec4f();
    var diagonal_a = vec4f();
    var diagonal_b = vec4f();
    var gradient_a = vec4f();
    var gradient_b = vec4f();
    if unit < params.images {
        for (var s = topology[unit]; s < topology[unit + 1u]; s += 1u) {
            a += partials[s].a;
            b += partials[s].b;
        }
        if b.z < MIN_OBSERVATIONS {
            a = vec4f();
            b = vec4f();
        }
        b = vec4f(b.xy, 0.0, 0.0);
    } else {
        let at = cameras_at(params.images) + unit - params.images;
        var count = 0.0;
        for (var m = topology[at]; m < topology[at + 1u]; m += 1u) {
            let image = topology[members_at(params.images, params.cameras) + m];
            var image_a = vec4f();
            var image_b = vec4f();
            for (var s = topology[image]; s < topology[image + 1u]; s += 1u) {
                image_a += partials[s].linear;
                image_b += partials[s].distortion;
                count += partials[s].b.z;
            }
            a += image_a;
            b += image_b;
        }
        let camera = unit - params.images;
        let prior = priors[camera];
        diagonal_a = prior.information_linear;
        diagonal_b = prior.information_distortion;
        gradient_a = diagonal_a * (intrinsics[camera].linear - prior.mean_linear);
        gradient_b = diagonal_b * (intrinsics[camera].distortion - prior.mean_distortion);
        let enough = count >= MIN_OBSERVATIONS;
        a = select(vec4f(), a + diagonal_a, (diagonal_a > vec4f()) | vec4<bool>(enough));
        b = select(vec4f(), b + diagonal_b, (diagonal_b > vec4f()) | vec4<bool>(enough));
    }
    let scale_a = freedom[2u * unit] * inverse_root(a);
    let scale_b = freedom[2u * unit + 1u] * inverse_root(b);
    let place = 2u * unit;
    vectors[section(SCALE, units) + place] = scale_a;
    vectors[section(SCALE, units) + place + 1u] = scale_b;
    vectors[section(PRIOR_DIAGONAL, units) + place] = scale_a * scale_a * diagonal_a;
    vectors[section(PRIOR_DIAGONAL, units) + place + 1u] = scale_b * scale_b * diagonal_b;
    vectors[section(PRIOR_GRADIENT, units) + place] = scale_a * gradient_a;
    vectors[section(PRIOR_GRADIENT, units) + place + 1u] = scale_b * gradient_b;
}
