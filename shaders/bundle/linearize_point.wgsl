// The undamped block of each point.

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"

// Ratio of R's diagonal beyond which a point has no position, as on the CPU.
const RANK_RATIO = 1e6;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> residuals: array<Residual>;
@group(0) @binding(7) var<storage, read_write> blocks: array<Block>;

@compute @workgroup_size(64)
fn linearize_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p >= params.points {
        return;
    }
    let point = points[p];
    var r = Triangle(vec3f(), vec3f());
    var gradient = vec3f();
    var count = 0u;
    for (var o = tracks[p]; o < tracks[track_end_at(params.points, p)]; o += 1u) {
        let seen = by_point[o];
        if seen.weight == 0.0 {
            continue;
        }
        let view = views[seen.image & IMAGE_MASK];
        let weights = point_weights(seen);
        let row = row_of(point, view, intrinsics[view.camera], params.cell, weights);
        r = fold_row(r, row.px);
        r = fold_row(r, row.py);
#if depth
        r = fold_row(r, row.pz);
#endif
        gradient += point_transposed(row, weighted(weights, accepted(residuals[o])));
        count += 1u;
    }
    let diagonal = abs(vec3f(r.top.x, r.bottom.x, r.bottom.z));
    let low = min(diagonal.x, min(diagonal.y, diagonal.z));
    let high = max(diagonal.x, max(diagonal.y, diagonal.z));
    let free = params.fixed_points == 0u && count >= 2u && low * RANK_RATIO > high;
    blocks[p] = Block(
        vec4f(r.top, 0.0),
        vec4f(r.bottom, 0.0),
        vec4f(gradient, 0.0),
        vec4f(column_norms(r), select(0.0, 1.0, free)),
        vec4f(),
        vec4f(),
    );
}
