// Schur–Jacobi blocks: J_cᵀ M J_c with M = I − J_p (R̃ᵀR̃)⁻¹ J_pᵀ inside each observation, and the right-hand side
// −J_cᵀ(r − J_p y₀). One row of 120 sums a segment: the upper triangle of 14 × 14 by rows, the 14 of the right-hand side.
// Sums go by batches of 64 observations, so no order depends on the device.

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"

const SIDE = 14u;
const TRIANGLE = 105u;
const SUMS = 120u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> blocks: array<Block>;
@group(0) @binding(5) var<storage, read> segments: array<Segment>;
@group(0) @binding(6) var<storage, read> by_image: array<ByImage>;
@group(0) @binding(7) var<storage, read> residuals: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> block_sums: array<f32>;

// Per observation J_c (2 × 14), M J_c (2 × 14) and the error r − J_p y₀.
var<workgroup> plain: array<f32, 1792>;
var<workgroup> projected: array<f32, 1792>;
var<workgroup> errors: array<vec2f, 64>;

fn store_step(lane: u32, line: u32, step: CameraStep) {
    let at = lane * 28u + line * SIDE;
    for (var k = 0u; k < 4u; k += 1u) {
        plain[at + k] = step.a[k];
        plain[at + 6u + k] = step.linear[k];
        plain[at + 10u + k] = step.distortion[k];
    }
    plain[at + 4u] = step.b.x;
    plain[at + 5u] = step.b.y;
}

// Row and column of an entry of the triangle; beyond it row SIDE and the place in the right-hand side.
fn entry_of(k: u32) -> vec2u {
    var row = 0u;
    var first = 0u;
    while row < SIDE && k >= first + SIDE - row {
        first += SIDE - row;
        row += 1u;
    }
    return vec2u(row, select(row + k - first, k - TRIANGLE, row == SIDE));
}

fn entry_sum(entry: vec2u) -> f32 {
    var sum = 0.0;
    for (var o = 0u; o < 64u; o += 1u) {
        let at = o * 28u;
        if entry.x < SIDE {
            sum += plain[at + entry.x] * projected[at + entry.y] + plain[at + SIDE + entry.x] * projected[at + SIDE + entry.y];
        } else if entry.y < SIDE {
            sum -= plain[at + entry.y] * errors[o].x + plain[at + SIDE + entry.y] * errors[o].y;
        }
    }
    return sum;
}

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
    let first = entry_of(lane);
    let second = entry_of(lane + 64u);
    var sums = vec2f();
    for (var batch = segment.start; batch < segment.end; batch += 64u) {
        let o = batch + lane;
        var row = Row(vec3f(), vec3f(), vec3f(), vec4f(), vec4f(), vec4f(), vec4f());
        var z = array<vec3f, 2>(vec3f(), vec3f());
        var e = vec2f();
        if o < segment.end && by_image[o].weight != 0.0 {
            let point = points[by_image[o].point];
            let block = blocks[by_image[o].point];
            row = row_of(point, view, k, params.cell, by_image[o].weight);
            z[0] = solve_row(block.damped_top.xyz, block.damped_bottom.xyz, row.px);
            z[1] = solve_row(block.damped_top.xyz, block.damped_bottom.xyz, row.py);
            e = by_image[o].weight * residuals[by_image[o].index].xy
                - vec2f(dot(row.px, point.s), dot(row.py, point.s));
        }
        store_step(lane, 0u, camera_transposed(row, vec2f(1.0, 0.0)));
        store_step(lane, 1u, camera_transposed(row, vec2f(0.0, 1.0)));
        errors[lane] = e;
        let mixed = -dot(z[0], z[1]);
        let mx = 1.0 - dot(z[0], z[0]);
        let my = 1.0 - dot(z[1], z[1]);
        let at = lane * 28u;
        for (var c = 0u; c < SIDE; c += 1u) {
            projected[at + c] = mx * plain[at + c] + mixed * plain[at + SIDE + c];
            projected[at + SIDE + c] = mixed * plain[at + c] + my * plain[at + SIDE + c];
        }
        workgroupBarrier();
        sums += vec2f(entry_sum(first), entry_sum(second));
        workgroupBarrier();
    }
    block_sums[segment.slot * SUMS + lane] = sums.x;
    if lane + 64u < SUMS {
        block_sums[segment.slot * SUMS + lane + 64u] = sums.y;
    }
}
