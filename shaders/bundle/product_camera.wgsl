// Second half of the reduced operator: v⊥ = J_c x − J_p y and its sums J_cᵀ v⊥, ‖v⊥‖² by segment. The cancellation
// happens inside each observation, before anything is summed (source: solver.md §1.3 a).

#import "common/dispatch.wgsl"
#import "bundle/segment_tree.wgsl"
#import "bundle/vectors.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> segments: array<Segment>;
@group(0) @binding(5) var<storage, read> by_image: array<ByImage>;
@group(0) @binding(6) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> partials: array<CameraStep>;

@compute @workgroup_size(64)
fn product_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if vectors[0].y != 0.0 {
        return;
    }
    let g = min(linear_group(group, num_groups), params.segments - 1u);
    let segment = segments[g];
    let view = views[segment.image];
    let k = intrinsics[view.camera];
    let start = section(SCALED, params.images + params.cameras);
    let x = load_step(start, segment.image, params.images + view.camera);
    var sum = no_step();
    for (var o = segment.start + lane; o < segment.end; o += 64u) {
        let seen = by_image[o];
        if seen.weight == 0.0 {
            continue;
        }
        let point = points[seen.point];
        let row = row_of(point, view, k, params.cell, image_weights(seen));
        let v = camera_product(row, x) - point_product(row, point.s);
        sum = add_steps(sum, camera_transposed(row, v));
    }
    let total = reduce_step(lane, sum);
    if lane == 0u {
        partials[segment.slot] = total;
    }
}
