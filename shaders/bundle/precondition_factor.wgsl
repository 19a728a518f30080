// Inverts the preconditioner's blocks in column scale: one workgroup an image (with its camera's parameters where it
// owns them), then one a shared camera (less what precondition_group found for it). The inverse is Gauss–Jordan in place; a block that is not positive definite in
// f32 is replaced by its diagonal.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"
#import "bundle/topology.wgsl"
#import "bundle/vectors.wgsl"
#import "bundle/block_sums.wgsl"

// Pivots below this are rounding: the scaled diagonal is 1.
const MIN_PIVOT = 1e-6;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> block_sums: array<f32>;
@group(0) @binding(2) var<storage, read> topology: array<u32>;
@group(0) @binding(3) var<storage, read> views: array<View>;
@group(0) @binding(4) var<storage, read_write> vectors: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> inverses: array<f32>;
@group(0) @binding(6) var<storage, read> group_sums: array<f32>;

var<workgroup> matrix: array<f32, ENTRIES>;
var<workgroup> diagonal: array<f32, SIDE>;
var<workgroup> failed: atomic<u32>;

// Place of an unknown (0..SIDE) of a block: vec4f and component in a section.
fn place(unit_of_pose: u32, unit_of_camera: u32, k: u32) -> vec2u {
    if k < 6u {
        return vec2u(UNIT_VEC4 * unit_of_pose + k / 4u, k % 4u);
    }
    return vec2u(UNIT_VEC4 * unit_of_camera + (k - 6u) / 4u, (k - 6u) % 4u);
}

// The sum over the segments of an image, or of all images of a camera, image by image.
fn gather(first: u32, last: u32, by_camera: bool, k: u32) -> f32 {
    var sum = 0.0;
    for (var m = first; m < last; m += 1u) {
        var image = m;
        if by_camera {
            image = topology[members_at(params.images, params.cameras) + m];
        }
        var part = 0.0;
        for (var s = topology[image]; s < topology[image + 1u]; s += 1u) {
            part += block_sums[s * SUMS + k];
        }
        sum += part;
    }
    return sum;
}

// What the points take from (i, j) of a shared camera's block; 0 where the block is not exact.
fn eliminated(camera: u32, i: u32, j: u32) -> f32 {
    let at = exact_at(params.images, params.cameras, params.big_cameras);
    let count = topology[at];
    var sum = 0.0;
    for (var which = 0u; which < count; which += 1u) {
        if topology[at + 2u + which] == camera {
            for (var s = 0u; s < topology[at + 1u]; s += 1u) {
                sum += group_sums[((s * count + which) * PARAMS + i) * PARAMS + j];
            }
        }
    }
    return sum;
}

@compute @workgroup_size(64)
fn precondition_factor(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let units = params.images + params.cameras;
    let unit = min(linear_group(group, num_groups), units - 1u);
    let by_camera = unit >= params.images;
    var camera = unit - params.images;
    if !by_camera {
        camera = views[unit].camera;
    }
    let at = cameras_at(params.images) + camera;
    let owned = topology[at + 1u] - topology[at] == 1u;
    // Unknowns begin..end belong to this block.
    let begin = select(0u, 6u, by_camera);
    let end = select(select(6u, SIDE, owned), SIDE, by_camera);
    var first = unit;
    var last = unit + 1u;
    if by_camera {
        first = topology[at];
        last = topology[at + 1u];
    }
    let scale_at = section(SCALE, units);
    if lane == 0u {
        atomicStore(&failed, 0u);
    }
    for (var k = lane; k < ENTRIES; k += 64u) {
        let i = k / SIDE;
        let j = k % SIDE;
        let low = min(i, j);
        let high = max(i, j);
        var value = 0.0;
        if low >= begin && high < end {
            let a = place(unit, params.images + camera, i);
            let b = place(unit, params.images + camera, j);
            let scale = vectors[scale_at + a.x][a.y] * vectors[scale_at + b.x][b.y];
            if scale != 0.0 {
                value = gather(first, last, by_camera, triangle_at(SIDE, low, high));
                if by_camera {
                    value -= eliminated(camera, low - 6u, high - 6u);
                }
                value *= scale;
                let prior = vectors[section(PRIOR_DIAGONAL, units) + a.x][a.y];
                value += select(0.0, params.lambda + prior, i == j);
            }
        }
        if i == j {
            // Unknowns out of the system: 1 now, 0 in the inverse.
            value = select(value, 1.0, value == 0.0);
            diagonal[i] = value;
        }
        matrix[k] = value;
    }
    workgroupBarrier();
    for (var pivot = 0u; pivot < SIDE; pivot += 1u) {
        let p = matrix[pivot * SIDE + pivot];
        if lane == 0u && !(p > MIN_PIVOT) {
            atomicStore(&failed, 1u);
        }
        let inverse = 1.0 / p;
        for (var k = lane; k < ENTRIES; k += 64u) {
            let i = k / SIDE;
            let j = k % SIDE;
            if i != pivot && j != pivot {
                matrix[k] -= matrix[i * SIDE + pivot] * matrix[pivot * SIDE + j] * inverse;
            }
        }
        workgroupBarrier();
        if lane < SIDE && lane != pivot {
            matrix[pivot * SIDE + lane] *= inverse;
            matrix[lane * SIDE + pivot] *= -inverse;
        }
        if lane == pivot {
            matrix[pivot * SIDE + pivot] = inverse;
        }
        workgroupBarrier();
    }
    let diagonal_only = atomicLoad(&failed) == 1u;
    for (var k = lane; k < ENTRIES; k += 64u) {
        let i = k / SIDE;
        let j = k % SIDE;
        var value = 0.5 * (matrix[k] + matrix[j * SIDE + i]);
        if diagonal_only {
            value = select(0.0, 1.0 / max(diagonal[i], MIN_PIVOT), i == j);
        }
        let a = place(unit, params.images + camera, i);
        let b = place(unit, params.images + camera, j);
        let inside = min(i, j) >= begin && max(i, j) < end;
        let scale = vectors[scale_at + a.x][a.y] * vectors[scale_at + b.x][b.y];
        inverses[unit * ENTRIES + k] = select(0.0, value, inside && scale != 0.0);
    }
    // The right-hand side, by the block that owns the unknowns; whole vectors, as neighbours must not share one.
    let quad = lane;
    let start = select(4u * quad - 2u, 4u * quad, quad < 2u);
    if start >= begin && start < end && !(by_camera && owned) {
        var sum = vec4f();
        let length = select(4u, 2u, quad == 1u);
        for (var k = 0u; k < length; k += 1u) {
            sum[k] = gather(first, last, by_camera, TRIANGLE + start + k);
        }
        let a = place(unit, params.images + camera, start);
        vectors[section(RHS, units) + a.x] =
            sum * vectors[scale_at + a.x] - vectors[section(PRIOR_GRADIENT, units) + a.x];
    }
}
