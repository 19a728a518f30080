// The points' step that follows from the cameras' step: y = −(R̃ᵀR̃)⁻¹(J_pᵀ r + J_pᵀ J_c x); the tried position takes the
// place of the step. Sums: ‖y‖² in column scale, J_pᵀr · y₀; largest |y| in column scale.

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
fn back_substitute(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var sum = Eight(vec4f(), vec4f());
    if p < params.points {
        let point = points[p];
        let block = blocks[p];
        let units = params.images + params.cameras;
        let x_at = section(X, units);
        let scale_at = section(SCALE, units);
        var gradient = block.gradient.xyz;
        let alone = solve_normal(block, gradient);
        if block.norms.w == 1.0 {
            for (var o = tracks[p]; o < tracks[track_end_at(params.points, p)]; o += 1u) {
                let seen = by_point[o];
                if seen.weight == 0.0 {
                    continue;
                }
                let image = seen.image & IMAGE_MASK;
                let view = views[image];
                let row = row_of(point, view, intrinsics[view.camera], params.cell, point_weights(seen));
                let x = load_step(x_at, image, params.images + view.camera);
                let scale = load_step(scale_at, image, params.images + view.camera);
                let step = CameraStep(scale.a * x.a, scale.b * x.b, multiply_units(scale.params, x.params));
                gradient += point_transposed(row, camera_product(row, step));
            }
        }
        let y = solve_normal(block, gradient);
        points[p].s = position(point) - y;
        let scaled = sqrt(block.norms.xyz) * abs(y);
        sum.a.x = dot(block.norms.xyz * y, y);
        sum.a.y = dot(block.gradient.xyz, alone);
        sum.b.w = max(scaled.x, max(scaled.y, scaled.z));
    }
    let total = reduce_eight(lane, sum);
    if lane == 0u && g < params.point_groups {
        sums[g] = total;
    }
}
