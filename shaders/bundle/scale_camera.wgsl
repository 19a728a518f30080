// Column scales 1/√diag of the camera unknowns, priors included; 0 takes an unknown out of the system: constant ones, and
// those of an image with too few observations that no prior holds. And the priors' part of the system in that scale.

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/topology.wgsl"
#import "bundle/store_unit.wgsl"

// As on the CPU: fewer observations do not fix a pose.
const MIN_OBSERVATIONS = 6.0;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> partials: array<CameraStep>;
@group(0) @binding(2) var<storage, read> topology: array<u32>;
// 1 where the unknown may move.
@group(0) @binding(3) var<storage, read> freedom: array<Unit>;
@group(0) @binding(4) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(5) var<storage, read> priors: array<Prior>;
@group(0) @binding(6) var<storage, read_write> vectors: array<vec4f>;

fn scale_of(free: vec4f, squares: vec4f, prior: vec4f, enough: bool) -> vec4f {
    let kept = select(vec4f(), squares + prior, (prior > vec4f()) | vec4<bool>(enough));
    return free * select(vec4f(), inverseSqrt(max(kept, vec4f(1e-30))), kept > vec4f(1e-30));
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
    var squares = no_unit();
    var diagonal = no_unit();
    var gradient = no_unit();
    var enough = false;
    if unit < params.images {
        var a = vec4f();
        var b = vec4f();
        for (var s = topology[unit]; s < topology[unit + 1u]; s += 1u) {
            a += partials[s].a;
            b += partials[s].b;
        }
        squares = short_unit(a, vec4f(b.xy, 0.0, 0.0));
        enough = b.z >= MIN_OBSERVATIONS;
    } else {
        let at = cameras_at(params.images) + unit - params.images;
        var count = 0.0;
        for (var m = topology[at]; m < topology[at + 1u]; m += 1u) {
            let image = topology[members_at(params.images, params.cameras) + m];
            var sum = no_unit();
            for (var s = topology[image]; s < topology[image + 1u]; s += 1u) {
                sum = add_units(sum, partials[s].params);
                count += partials[s].b.z;
            }
            squares = add_units(squares, sum);
        }
        let camera = unit - params.images;
        let prior = priors[camera];
        diagonal = prior.information;
        gradient = multiply_units(diagonal, minus_units(intrinsics[camera].params, prior.mean));
        enough = count >= MIN_OBSERVATIONS;
    }
    let free = freedom[unit];
    var scale = no_unit();
    scale.a = scale_of(free.a, squares.a, diagonal.a, enough);
    scale.b = scale_of(free.b, squares.b, diagonal.b, enough);
#if wide
    scale.c = scale_of(free.c, squares.c, diagonal.c, enough);
    scale.d = scale_of(free.d, squares.d, diagonal.d, enough);
#endif
    store_unit(section(SCALE, units), unit, scale);
    store_unit(section(PRIOR_DIAGONAL, units), unit, multiply_units(multiply_units(scale, scale), diagonal));
    store_unit(section(PRIOR_GRADIENT, units), unit, multiply_units(scale, gradient));
}
