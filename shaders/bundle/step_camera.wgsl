// The tried state of images and cameras: R exp([ω]×), everything else added; and centres back into their cells.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"
#import "bundle/vectors.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> views: array<View>;
@group(0) @binding(3) var<storage, read_write> intrinsics: array<Intrinsics>;

// row · exp([ω]×).
fn turned(row: vec3f, w: vec3f) -> vec3f {
    let square = dot(w, w);
    let angle = sqrt(square);
    var sine = 1.0 - square / 6.0;
    var cosine = 0.5 - square / 24.0;
    if square > 1e-4 {
        sine = sin(angle) / angle;
        cosine = (1.0 - cos(angle)) / square;
    }
    // row · [ω]× = row × ω.
    let first = cross(row, w);
    return row + sine * first + cosine * cross(first, w);
}

@compute @workgroup_size(64)
fn step_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let unit = linear_group(group, num_groups) * 64u + lane;
    let units = params.images + params.cameras;
    if unit >= units {
        return;
    }
    let step = multiply_units(load_unit(section(SCALE, units), unit), load_unit(section(X, units), unit));
    if unit >= params.images {
        let camera = unit - params.images;
        var next = intrinsics[camera];
        next.params = add_units(next.params, step);
        if next.kind.x == 1u {
            next.params.a.y += step.a.x;
        }
        intrinsics[camera + params.cameras] = next;
        return;
    }
    let a = step.a;
    let b = step.b;
    var next = views[unit];
    if any(a.xyz != vec3f()) {
        // Rounding must not add up to rows that are no rotation.
        let x = turned(next.r0.xyz, a.xyz);
        let y = turned(next.r1.xyz, a.xyz);
        let first = normalize(x);
        let second = normalize(y - dot(first, y) * first);
        next.r0 = vec4f(first, next.r0.w);
        next.r1 = vec4f(second, next.r1.w);
        next.r2 = vec4f(cross(first, second), next.r2.w);
    }
    let center = vec3f(next.r0.w, next.r1.w, next.r2.w) + vec3f(a.w, b.xy);
    let cells = select(vec3f(), round(center / params.cell), abs(center) > vec3f(params.cell));
    let offset = center - params.cell * cells;
    next.cell += vec3i(cells);
    next.r0.w = offset.x;
    next.r1.w = offset.y;
    next.r2.w = offset.z;
    views[unit + params.images] = next;
}
