// What the two vector kernels of PCG share: the preconditioner D⁻¹ + Z A⁻¹ Zᵀ and the unit an invocation works on.

#import "bundle/types.wgsl"
#import "bundle/row.wgsl"
#import "bundle/modes.wgsl"
#import "bundle/store_unit.wgsl"
#import "bundle/block_sums.wgsl"
#import "common/tree.wgsl"

const LANES = 256u;
// Rows of the coarse matrix's blocks that a camera takes.
const EIGHTHS = UNIT_VEC4 / 2u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> topology: array<u32>;
@group(0) @binding(2) var<storage, read> inverses: array<f32>;
@group(0) @binding(3) var<storage, read_write> vectors: array<vec4f>;
@group(0) @binding(4) var<storage, read> modes: array<Mode>;
// First whether there is one (x), then A⁻¹ by rows.
@group(0) @binding(5) var<storage, read> coarse_inverse: array<vec4f>;

fn load(which: u32, unit: u32) -> Unit {
    return load_unit(section(which, params.images + params.cameras), unit);
}

fn store(which: u32, unit: u32, value: Unit) {
    store_unit(section(which, params.images + params.cameras), unit, value);
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

// The unit's part of D⁻¹ r.
fn precondition_alone(unit: u32) -> Unit {
    if unit < params.images {
        let pose = load(RESIDUAL, unit);
        let camera = load(RESIDUAL, params.images + topology[camera_of_at(params.images, params.cameras) + unit]);
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

// Where the lists of clusters are, and the number of cameras with an exact block, whose rows follow those of clusters.
fn exact_count() -> u32 {
    return topology[exact_at(params.images, params.cameras, params.big_cameras)];
}

fn clusters_start() -> u32 {
    return clusters_at(params.images, params.cameras, params.big_cameras, exact_count());
}

fn has_coarse_space() -> bool {
    return topology[clusters_start()] > 0u && coarse_inverse[0].x != 0.0;
}

fn coarse_at() -> u32 {
    return section(COARSE, params.images + params.cameras);
}

// From scaled unknowns to their own units: 0 for those out of the system.
fn inverse_scale(unit: u32) -> Unit {
    var out = load(SCALE, unit);
    out.a = select(vec4f(), 1.0 / out.a, out.a != vec4f());
    out.b = select(vec4f(), 1.0 / out.b, out.b != vec4f());
#if wide
    out.c = select(vec4f(), 1.0 / out.c, out.c != vec4f());
    out.d = select(vec4f(), 1.0 / out.d, out.d != vec4f());
#endif
    return out;
}

// The members from `start`, every `width`-th, of Zᵀ r.
fn restricted(start: u32, end: u32, width: u32) -> Eight {
    var sum = Eight(vec4f(), vec4f());
    for (var m = start; m < end; m += width) {
        let mode = modes[topology[m]];
        let image = topology[m] / MEMBERSHIPS;
        let r = load(RESIDUAL, image);
        let unscaled = inverse_scale(image);
        let rotation = r.a.xyz * unscaled.a.xyz;
        let center = vec3f(r.a.w * unscaled.a.w, r.b.xy * unscaled.b.xy);
        let turned = cross(mode.from_center, center) - mode.inverse_radius * rotation;
        sum.a += mode.weight * vec4f(center, turned.x);
        sum.b += mode.weight * vec4f(turned.yz, dot(mode.from_center, center), 0.0);
    }
    return sum;
}

// y = A⁻¹ Zᵀ r, left behind the vectors. Must be reached by all lanes.
fn solve_coarse(lane: u32) {
    if !has_coarse_space() {
        return;
    }
    let at = clusters_start();
    let clusters = topology[at];
    let members = at + clusters + 2u;
    let rows = clusters + EIGHTHS * exact_count();
    var width = 1u;
    while 2u * width * clusters <= LANES {
        width *= 2u;
    }
    for (var first = 0u; first < clusters; first += LANES / width) {
        let cluster = first + lane / width;
        var sum = Eight(vec4f(), vec4f());
        if cluster < clusters {
            let start = members + topology[at + 1u + cluster] + lane % width;
            sum = restricted(start, members + topology[at + 2u + cluster], width);
        }
        let total = reduce_eight_within(lane, sum, width);
        if cluster < clusters && lane % width == 0u {
            vectors[coarse_at() + 2u * cluster] = total.a;
            vectors[coarse_at() + 2u * cluster + 1u] = total.b;
        }
        workgroupBarrier();
    }
    if lane < exact_count() {
        let exact = exact_at(params.images, params.cameras, params.big_cameras);
        let unit = params.images + topology[exact + 2u + lane];
        let r = multiply_units(load(RESIDUAL, unit), inverse_scale(unit));
        store_unit(coarse_at() + 2u * clusters, lane, r);
    }
    storageBarrier();
    for (var quad = lane; quad < 2u * rows; quad += LANES) {
        var sum = vec4f();
        for (var k = 0u; k < 2u * rows; k += 1u) {
            let r = vectors[coarse_at() + k];
            let line = 1u + 4u * k * 2u * rows + quad;
            sum += coarse_inverse[line] * r.x + coarse_inverse[line + 2u * rows] * r.y;
            sum += coarse_inverse[line + 4u * rows] * r.z + coarse_inverse[line + 6u * rows] * r.w;
        }
        vectors[coarse_at() + 2u * rows + quad] = sum;
    }
    storageBarrier();
}

// The unit's part of Z y.
fn prolonged(unit: u32) -> Unit {
    var step = no_unit();
    if !has_coarse_space() {
        return step;
    }
    let clusters = topology[clusters_start()];
    let y_at = coarse_at() + 2u * (clusters + EIGHTHS * exact_count());
    if unit < params.images {
        for (var k = 0u; k < MEMBERSHIPS; k += 1u) {
            let mode = modes[unit * MEMBERSHIPS + k];
            if mode.cluster != NO_CLUSTER && mode.weight != 0.0 {
                let a = vectors[y_at + 2u * mode.cluster];
                let b = vectors[y_at + 2u * mode.cluster + 1u];
                let turn = vec3f(a.w, b.xy);
                let center = mode.weight * (a.xyz + cross(turn, mode.from_center) + b.z * mode.from_center);
                let rotation = -mode.weight * mode.inverse_radius * turn;
                step.a += vec4f(rotation, center.x);
                step.b += vec4f(center.yz, 0.0, 0.0);
            }
        }
    } else {
        let exact = exact_at(params.images, params.cameras, params.big_cameras);
        for (var which = 0u; which < exact_count(); which += 1u) {
            if params.images + topology[exact + 2u + which] == unit {
                step = load_unit(y_at + 2u * clusters, which);
            }
        }
    }
    return multiply_units(step, inverse_scale(unit));
}

// The unit's part of M⁻¹ r, after solve_coarse.
fn precondition(unit: u32) -> Unit {
    return add_units(precondition_alone(unit), prolonged(unit));
}
