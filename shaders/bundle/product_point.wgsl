// First half of the reduced operator: y = (R̃ᵀR̃)⁻¹ J_pᵀ J_c x for every point, and the sum of λ‖y‖² in column scale.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"
#import "bundle/vectors.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read_write> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> blocks: array<Block>;
@group(0) @binding(7) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> sums: array<Eight>;

@compute @workgroup_size(64)
fn product_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if vectors[0].y != 0.0 {
        return;
    }
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var squares = 0.0;
    if p < params.points {
        let point = points[p];
        let block = blocks[p];
        let start = section(SCALED, params.images + params.cameras);
        var gradient = vec3f();
        if block.norms.w == 1.0 {
            for (var o = tracks[p]; o < tracks[track_end_at(params.points, p)]; o += 1u) {
                let seen = by_point[o];
                if seen.weight == 0.0 {
                    continue;
                }
                let image = seen.image & IMAGE_MASK;
                let view = views[image];
                let row = row_of(point, view, intrinsics[view.camera], params.cell, point_weights(seen));
                let v = camera_product(row, load_step(start, image, params.images + view.camera));
                gradient += point_transposed(row, v);
            }
        }
        let y = solve_normal(block, gradient);
        points[p].s = y;
        squares = params.lambda * dot(block.norms.xyz * y, y);
    }
    let total = reduce_eight(lane, Eight(vec4f(squares, 0.0, 0.0, 0.0), vec4f()));
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
