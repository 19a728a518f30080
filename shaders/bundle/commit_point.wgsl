// Makes the tried positions and residuals the accepted ones. An observation that fell behind its camera leaves for good,
// with its last residual. A point that left its cell moves to the one it is in: exact, as cells are powers of two.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> points: array<Point>;
@group(0) @binding(2) var<storage, read> tracks: array<u32>;
@group(0) @binding(3) var<storage, read_write> by_point: array<ByPoint>;
@group(0) @binding(4) var<storage, read_write> residuals: array<Residual>;

@compute @workgroup_size(64)
fn commit_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p >= params.points {
        return;
    }
    for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
        let r = residuals[o];
        if r.pixel.z == INVALID {
            by_point[o].image |= OUT;
            residuals[o] = with_errors(r, accepted(r), accepted(r));
        } else {
            residuals[o] = with_errors(r, tried(r), tried(r));
        }
    }
    var point = points[p];
    let cells = select(vec3f(), round(point.s / params.cell), abs(point.s) > vec3f(params.cell));
    // The lattice has 1024 cells an axis; beyond it the offset grows instead.
    let target_cell = clamp(point_cell(point) + vec3i(cells), vec3i(0), vec3i(1023));
    let offset = point.s - params.cell * vec3f(target_cell - point_cell(point));
    let packed = vec3u(target_cell);
    points[p] = Point(offset.x, offset.y, offset.z, packed.x | (packed.y << 10u) | (packed.z << 20u), vec3f(), 0.0);
}
