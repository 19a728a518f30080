// Robust weights and scales once for the whole linearisation (8 B an observation to keep, against 24 to compute them in
// every product), and the undamped block of each point by Givens QR. Sums: the objective, observations that pull.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "positioning/model.wgsl"
#import "positioning/block.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> settings: Settings;
@group(0) @binding(2) var<storage, read> centers: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read_write> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> rays: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> blocks: array<PointBlock>;
@group(0) @binding(8) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> sums: array<Eight>;

@compute @workgroup_size(64)
fn position_linearize(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var cost = 0.0;
    var pulling = 0.0;
    if p < params.points {
        let x = points[p].x;
        let least = vectors[3].x;
        var r = Triangle(vec3f(), vec3f());
        var gradient = vec3f();
        // Multiples of the identity add up before they are folded: three rotations instead of three an observation.
        var isotropic = 0.0;
        for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
            let center = centers[by_point[o].camera];
            let found = linearize(settings, rays[o], center.w, x - center.xyz, least);
            by_point[o].scale = kept(found.row);
            cost += found.cost;
            pulling += found.pulls;
            gradient += found.gradient;
            if all(found.row.direction == vec3f()) {
                isotropic += found.row.scale * found.row.scale;
            } else {
                r = fold_across(r, found.row.scale, found.row.direction);
            }
        }
        r = fold_identity(r, vec3f(sqrt(isotropic)));
        points[p].cost = cost;
        blocks[p] = PointBlock(
            vec4f(r.top, gradient.x),
            vec4f(r.bottom, gradient.y),
            vec4f(0.0, 0.0, 0.0, gradient.z),
            vec4f(),
        );
    }
    let total = reduce_eight(lane, Eight(vec4f(0.0, cost, 0.0, pulling), vec4f()));
    let row = params.first_group + g;
    if lane == 0u && g * LANES < params.points {
        sums[row] = total;
    }
}
