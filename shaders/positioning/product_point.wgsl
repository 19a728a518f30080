// First half of the reduced operator: y = (R̃ᵀR̃)⁻¹ Σ A A p for every point, and the sum of λ yᵀDy.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "positioning/row.wgsl"
#import "positioning/block.wgsl"
#import "positioning/vectors.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> settings: Settings;
@group(0) @binding(2) var<storage, read> centers: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> rays: array<vec4f>;
@group(0) @binding(7) var<storage, read> blocks: array<PointBlock>;
@group(0) @binding(8) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> sums: array<Eight>;

@compute @workgroup_size(64)
fn position_product_point(
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
        let x = points[p].x;
        let block = blocks[p];
        let start = section(DIRECTION, settings.cameras);
        var sum = vec3f();
        for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
            let camera = by_point[o].camera;
            var ray = vec3f();
            if settings.stage == LUD {
                ray = rays[o].xyz;
            }
            let row = row_of(by_point[o].scale, x - centers[camera].xyz, ray, settings.stage);
            sum += apply_block(row, vectors[start + camera].xyz);
        }
        let y = solve_block(block, sum);
        points[p].s = y;
        squares = settings.lambda * dot(damping_diagonal(block) * y, y);
    }
    let total = reduce_eight(lane, Eight(vec4f(squares, 0.0, 0.0, 0.0), vec4f()));
    let row = params.first_group + g;
    if lane == 0u && g * LANES < params.points {
        sums[row] = total;
    }
}
