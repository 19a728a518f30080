// Second half of the reduced operator: e = A (p − y) and its sums A e, ‖e‖² by segment. The cancellation happens inside
// each observation, before anything is summed (source: solver.md §1.3 a).

#import "common/dispatch.wgsl"
#import "positioning/row.wgsl"
#import "positioning/vectors.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> settings: Settings;
@group(0) @binding(2) var<storage, read> centers: array<vec4f>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> segments: array<Segment>;
@group(0) @binding(5) var<storage, read> by_camera: array<ByCamera>;
@group(0) @binding(6) var<storage, read> rays: array<vec4f>;
@group(0) @binding(7) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> partials: array<vec4f>;

var<workgroup> tree: array<vec4f, 64>;

@compute @workgroup_size(64)
fn position_product_camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if vectors[0].y != 0.0 {
        return;
    }
    let g = min(linear_group(group, num_groups), params.segments - 1u);
    let segment = segments[g];
    let center = centers[segment.camera].xyz;
    let direction = vectors[section(DIRECTION, settings.cameras) + segment.camera].xyz;
    var sum = vec4f();
    for (var o = segment.start + lane; o < segment.end; o += 64u) {
        let point = points[by_camera[o].point];
        var ray = vec3f();
        if settings.stage == LUD {
            ray = rays[by_camera[o].index].xyz;
        }
        let row = row_of(by_camera[o].scale, point.x - center, ray, settings.stage);
        let e = apply_root(row, direction - point.s);
        sum += vec4f(apply_root(row, e), dot(e, e));
    }
    tree[lane] = sum;
    for (var stride = 32u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            let x = tree[lane];
            let y = tree[lane + stride];
            tree[lane] = x + y;
        }
    }
    workgroupBarrier();
    if lane == 0u {
        partials[params.first_segment + g] = tree[0];
    }
}
