// Schur–Jacobi blocks: J_cᵀ M J_c with M = I − J_p (R̃ᵀR̃)⁻¹ J_pᵀ inside each observation, and the right-hand side
// −J_cᵀ(r − J_p y₀). Where precondition_group adds the exact block of a shared camera, everything that concerns its
// parameters is plain J_cᵀ J_c. One row of sums a segment, see block_sums.wgsl.
// Sums go by batches of 64 observations, so no order depends on the device.

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"
#import "bundle/block_sums.wgsl"

const PER_LANE = (SUMS + 63u) / 64u;
const PROJECTED = 0u;
const PLAIN = 1u;
const RIGHT_HAND_SIDE = 2u;
const NOTHING = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> blocks: array<Block>;
@group(0) @binding(5) var<storage, read> segments: array<Segment>;
@group(0) @binding(6) var<storage, read> by_image: array<ByImage>;
@group(0) @binding(7) var<storage, read> residuals: array<Residual>;
@group(0) @binding(8) var<storage, read_write> block_sums: array<f32>;

// Per observation J_c (2 × SIDE), M (xx, xy, yy) and the error r − J_p y₀.
var<workgroup> plain: array<f32, 64u * 2u * SIDE>;
var<workgroup> projections: array<vec3f, 64>;
var<workgroup> errors: array<Errors, 64>;
#if depth
// The depth's row of J_c, which ends with the pose, and of M (xz, yz, zz).
var<workgroup> depth_plain: array<f32, 64u * 6u>;
var<workgroup> depth_projections: array<vec3f, 64>;
#endif

fn store_step(lane: u32, line: u32, step: CameraStep) {
    let at = lane * 2u * SIDE + line * SIDE;
    for (var k = 0u; k < 4u; k += 1u) {
        plain[at + k] = step.a[k];
        plain[at + 6u + k] = step.params.a[k];
        plain[at + 10u + k] = step.params.b[k];
#if wide
        plain[at + 14u + k] = step.params.c[k];
        plain[at + 18u + k] = step.params.d[k];
#endif
    }
    plain[at + 4u] = step.b.x;
    plain[at + 5u] = step.b.y;
}

#if depth
fn store_depth_step(lane: u32, step: CameraStep) {
    for (var k = 0u; k < 4u; k += 1u) {
        depth_plain[lane * 6u + k] = step.a[k];
    }
    depth_plain[lane * 6u + 4u] = step.b.x;
    depth_plain[lane * 6u + 5u] = step.b.y;
}
#endif

struct Entry {
    row: u32,
    column: u32,
    kind: u32,
}

// What the k-th sum is.
fn entry_of(k: u32, exact: bool) -> Entry {
    if k >= SUMS {
        return Entry(0u, 0u, NOTHING);
    }
    if k >= TRIANGLE && k < POSE_AT {
        return Entry(k - TRIANGLE, 0u, RIGHT_HAND_SIDE);
    }
    let side = select(SIDE, 6u, k >= POSE_AT);
    var left = select(k, k - POSE_AT, k >= POSE_AT);
    var row = 0u;
    while left >= side - row {
        left -= side - row;
        row += 1u;
    }
    let column = row + left;
    return Entry(row, column, select(PROJECTED, PLAIN, k >= POSE_AT || (exact && column >= 6u)));
}

fn entry_sum(entry: Entry) -> f32 {
    var sum = 0.0;
    if entry.kind == NOTHING {
        return sum;
    }
    for (var o = 0u; o < 64u; o += 1u) {
        let at = o * 2u * SIDE;
        let x = plain[at + entry.row];
        let y = plain[at + SIDE + entry.row];
        if entry.kind == RIGHT_HAND_SIDE {
            sum -= x * errors[o].x + y * errors[o].y;
        } else {
            let u = plain[at + entry.column];
            let v = plain[at + SIDE + entry.column];
            let m = select(projections[o], vec3f(1.0, 0.0, 1.0), entry.kind == PLAIN);
            sum += x * (m.x * u + m.y * v) + y * (m.y * u + m.z * v);
        }
#if depth
        sum += depth_term(entry, o);
#endif
    }
    return sum;
}

#if depth
// What the depth's row of an observation adds to a sum.
fn depth_term(entry: Entry, o: u32) -> f32 {
    let z = select(0.0, depth_plain[o * 6u + min(entry.row, 5u)], entry.row < 6u);
    if entry.kind == RIGHT_HAND_SIDE {
        return -z * errors[o].z;
    }
    let w = select(0.0, depth_plain[o * 6u + min(entry.column, 5u)], entry.column < 6u);
    if entry.kind == PLAIN {
        return z * w;
    }
    let at = o * 2u * SIDE;
    let m = depth_projections[o];
    let by_row = m.x * plain[at + entry.row] + m.y * plain[at + SIDE + entry.row];
    let by_column = m.x * plain[at + entry.column] + m.y * plain[at + SIDE + entry.column];
    return by_row * w + z * (by_column + m.z * w);
}
#endif

@compute @workgroup_size(64)
fn precondition_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = min(linear_group(group, num_groups), params.segments - 1u);
    let segment = segments[g];
    let view = views[segment.image];
    let k = intrinsics[view.camera];
    var entries: array<Entry, PER_LANE>;
    var sums: array<f32, PER_LANE>;
    for (var n = 0u; n < PER_LANE; n += 1u) {
        entries[n] = entry_of(lane + 64u * n, k.kind.w == 1u);
    }
    for (var batch = segment.start; batch < segment.end; batch += 64u) {
        let o = batch + lane;
        var row = Row();
        var block = Block();
        var e = Errors();
        if o < segment.end && by_image[o].weight != 0.0 {
            let seen = by_image[o];
            let point = points[seen.point];
            let weights = image_weights(seen);
            block = blocks[seen.point];
            row = row_of(point, view, k, params.cell, weights);
            e = weighted(weights, accepted(residuals[seen.index])) - point_product(row, point.s);
        }
        let x = solve_row(block.damped_top.xyz, block.damped_bottom.xyz, row.px);
        let y = solve_row(block.damped_top.xyz, block.damped_bottom.xyz, row.py);
        store_step(lane, 0u, camera_transposed(row, X_ERROR));
        store_step(lane, 1u, camera_transposed(row, Y_ERROR));
        errors[lane] = e;
        projections[lane] = vec3f(1.0 - dot(x, x), -dot(x, y), 1.0 - dot(y, y));
#if depth
        let z = solve_row(block.damped_top.xyz, block.damped_bottom.xyz, row.pz);
        store_depth_step(lane, camera_transposed(row, DEPTH_ERROR));
        depth_projections[lane] = vec3f(-dot(x, z), -dot(y, z), 1.0 - dot(z, z));
#endif
        workgroupBarrier();
        for (var n = 0u; n < PER_LANE; n += 1u) {
            sums[n] += entry_sum(entries[n]);
        }
        workgroupBarrier();
    }
    for (var n = 0u; n < PER_LANE; n += 1u) {
        if lane + 64u * n < SUMS {
            block_sums[segment.slot * SUMS + lane + 64u * n] = sums[n];
        }
    }
}
