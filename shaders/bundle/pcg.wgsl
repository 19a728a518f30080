// What the two vector kernels of PCG share: the preconditioner and the unit an invocation works on.

#import "bundle/types.wgsl"
#import "bundle/row.wgsl"
#import "bundle/topology.wgsl"
#import "bundle/vectors.wgsl"
#import "bundle/block_sums.wgsl"
#import "common/tree.wgsl"

const LANES = 256u;
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> topology: array<u32>;
@group(0) @binding(2) var<storage, read> views: array<View>;
@group(0) @binding(3) var<storage, read> inverses: array<f32>;
@group(0) @binding(4) var<storage, read_write> vectors: array<vec4f>;

fn load(which: u32, unit: u32) -> Unit {
    return load_unit(section(which, params.images + params.cameras), unit);
}

fn store(which: u32, unit: u32, value: Unit) {
    let at = section(which, params.images + params.cameras) + UNIT_VEC4 * unit;
    vectors[at] = value.a;
    vectors[at + 1u] = value.b;
#if wide
    vectors[at + 2u] = value.c;
    vectors[at + 3u] = value.d;
#endif
}

// Rows begin..begin + 4 of an inverse times the pose and camera parts of a vector.
fn inverse_rows(block: u32, begin: u32, pose: Unit, camera: Unit) -> vec4f {
    var out = vec4f();
    for (var i = 0u; i < 4u; i += 1u) {
        if begin + i >= SIDE {
            continue;
        }
        let at = block * ENTRIES + (begin + i) * SIDE;
        var sum = 0.0;
        for (var j = 0u; j < 4u; j += 1u) {
            sum += inverses[at + j] * pose.a[j] + inverses[at + 6u + j] * camera.a[j] + inverses[at + 10u + j] * camera.b[j];
#if wide
            sum += inverses[at + 14u + j] * camera.c[j] + inverses[at + 18u + j] * camera.d[j];
#endif
        }
        out[i] = sum + inverses[at + 4u] * pose.b.x + inverses[at + 5u] * pose.b.y;
    }
    return out;
}

// The unit's part of M⁻¹ r.
fn precondition(unit: u32) -> Unit {
    if unit < params.images {
        let pose = load(RESIDUAL, unit);
        let camera = load(RESIDUAL, params.images + views[unit].camera);
        let b = inverse_rows(unit, 4u, pose, camera);
        return short_unit(inverse_rows(unit, 0u, pose, camera), vec4f(b.xy, 0.0, 0.0));
    }
    let at = cameras_at(params.images) + unit - params.images;
    var block = unit;
    var pose = no_unit();
    if topology[at + 1u] - topology[at] == 1u {
        block = topology[members_at(params.images, params.cameras) + topology[at]];
        pose = load(RESIDUAL, block);
    }
    let camera = load(RESIDUAL, unit);
    var out = short_unit(inverse_rows(block, 6u, pose, camera), inverse_rows(block, 10u, pose, camera));
#if wide
    out.c = inverse_rows(block, 14u, pose, camera);
    out.d = inverse_rows(block, 18u, pose, camera);
#endif
    return out;
}
