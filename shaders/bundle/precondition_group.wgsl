// What eliminating the points takes from the block of a shared camera's parameters: Σ_points (R̃⁻ᵀ W)ᵀ (R̃⁻ᵀ W) with
// W = Σ J_pᵀ J_K over all observations of a point by images of the camera. These cross terms of different observations
// are what makes the block exact (source: solver.md §5.6, scale.md R9). One workgroup a span of points and camera.

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"
#import "bundle/topology.wgsl"
#import "bundle/block_sums.wgsl"

const PER_LANE = PARAMS * PARAMS / 64u;
// As MAX_SPANS in resident.rs: keeps the sum over a chunk's spans short.
const MAX_SPANS = 256u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> blocks: array<Block>;
@group(0) @binding(7) var<storage, read> topology: array<u32>;
@group(0) @binding(8) var<storage, read_write> group_sums: array<f32>;

// R̃⁻ᵀ W of 64 points, 3 × PARAMS each.
var<workgroup> factors: array<f32, 64u * 3u * PARAMS>;

@compute @workgroup_size(64)
fn precondition_group(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let spans = clamp(params.point_groups, 1u, MAX_SPANS);
    let batches = (params.point_groups + spans - 1u) / spans;
    let exact = exact_at(params.images, params.cameras, params.big_cameras);
    let count = max(topology[exact], 1u);
    let camera = topology[exact + 2u + g % count];
    var sums: array<f32, PER_LANE>;
    for (var batch = 0u; batch < batches; batch += 1u) {
        let p = ((g / count) * batches + batch) * 64u + lane;
        var columns = array<vec3f, PARAMS>();
        if p < params.points && blocks[p].norms.w == 1.0 {
            let point = points[p];
            for (var o = tracks[p]; o < tracks[track_end_at(params.points, p)]; o += 1u) {
                let seen = by_point[o];
                let view = views[seen.image & IMAGE_MASK];
                if seen.weight == 0.0 || view.camera != camera {
                    continue;
                }
                let row = row_of(point, view, intrinsics[camera], params.cell, point_weights(seen));
                for (var k = 0u; k < 4u; k += 1u) {
                    columns[k] += row.px * row.x_params.a[k] + row.py * row.y_params.a[k];
                    columns[4u + k] += row.px * row.x_params.b[k] + row.py * row.y_params.b[k];
#if wide
                    columns[8u + k] += row.px * row.x_params.c[k] + row.py * row.y_params.c[k];
                    columns[12u + k] += row.px * row.x_params.d[k] + row.py * row.y_params.d[k];
#endif
                }
            }
        }
        for (var k = 0u; k < PARAMS; k += 1u) {
            var factor = vec3f();
            if p < params.points {
                factor = solve_row(blocks[p].damped_top.xyz, blocks[p].damped_bottom.xyz, columns[k]);
            }
            for (var c = 0u; c < 3u; c += 1u) {
                factors[(lane * 3u + c) * PARAMS + k] = factor[c];
            }
        }
        workgroupBarrier();
        for (var n = 0u; n < PER_LANE; n += 1u) {
            let row = (lane + 64u * n) / PARAMS;
            let column = (lane + 64u * n) % PARAMS;
            var sum = 0.0;
            for (var q = 0u; q < 192u; q += 1u) {
                sum += factors[q * PARAMS + row] * factors[q * PARAMS + column];
            }
            sums[n] += sum;
        }
        workgroupBarrier();
    }
    if g < spans * count {
        for (var n = 0u; n < PER_LANE; n += 1u) {
            group_sums[g * PARAMS * PARAMS + lane + 64u * n] = sums[n];
        }
    }
}
