// The points' step that follows from the cameras' step, δX = (R̃ᵀR̃)⁻¹(Σ A A δC − g), and what the objective says to it.
// Sums: decrease, objective after, unused, observations that pull; gᵀ(R̃ᵀR̃)⁻¹g, δXᵀDδX.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "positioning/model.wgsl"
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

// A position, what it costs with the tried centres, and how many observations pull there.
struct Candidate {
    x: vec3f,
    cost: f32,
    pulling: f32,
}

fn evaluate(p: u32, x: vec3f) -> Candidate {
    let least = vectors[3].x;
    var out = Candidate(x, 0.0, 0.0);
    for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
        let center = centers[settings.cameras + by_point[o].camera];
        let found = linearize(settings, rays[o], center.w, x - center.xyz, least);
        out.cost += found.cost;
        out.pulling += found.pulls;
    }
    return out;
}

fn cheaper(a: Candidate, b: Candidate) -> Candidate {
    if is_finite(b.cost) && (b.cost < a.cost || !is_finite(a.cost)) {
        return b;
    }
    return a;
}

// Where the rays meet: least squares of their distances over their lengths. The given position where they do not.
fn meeting_point(p: u32, x: vec3f) -> vec3f {
    var r = Triangle(vec3f(), vec3f());
    var right = vec3f();
    for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
        let center = centers[settings.cameras + by_point[o].camera];
        let d = x - center.xyz;
        if rays[o].w >= 0.0 {
            let ray = ray_of(rays[o]);
            let row = Row(ray.direction, sqrt(center.w * ray.share / max(dot(d, d), ON_CAMERA)));
            r = fold_across(r, row.scale, row.direction);
            right += apply_block(row, center.xyz);
        }
    }
    let inverse = inverted_diagonal(r);
    let meeting = solve_triangle(inverse.top, inverse.bottom, right);
    let good = inverse.top.x > 0.0 && is_finite(dot(meeting, meeting));
    return select(x, meeting, good);
}

@compute @workgroup_size(64)
fn position_step_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = linear_group(group, num_groups);
    let p = g * LANES + lane;
    var sum = Eight(vec4f(), vec4f());
    if p < params.points {
        let x = points[p].x;
        let before = points[p].cost;
        let block = blocks[p];
        let start = section(X, settings.cameras);
        let gradient = block_gradient(block);
        var right = -gradient;
        for (var o = tracks[p]; o < tracks[p + 1u]; o += 1u) {
            let camera = by_point[o].camera;
            var ray = vec3f();
            if settings.stage == LUD {
                ray = rays[o].xyz;
            }
            let row = row_of(by_point[o].scale, x - centers[camera].xyz, ray, settings.stage);
            right += apply_block(row, vectors[start + camera].xyz);
        }
        let step = solve_block(block, right);
        var best = evaluate(p, x + step);
        // Where the step makes the point itself worse (the model of a far point is poor, and one such point could have
        // a good step of all cameras refused): half of it, none of it, or where its rays meet.
        if settings.stage == PROJECT && !(best.cost <= before) {
            best = cheaper(best, evaluate(p, x + 0.5 * step));
            best = cheaper(best, evaluate(p, x));
            best = cheaper(best, evaluate(p, meeting_point(p, x)));
        }
        points[p].s = best.x;
        let alone = solve_block(block, gradient);
        sum.a = vec4f(before - best.cost, best.cost, 0.0, best.pulling);
        sum.b = vec4f(dot(gradient, alone), dot(damping_diagonal(block) * step, step), 0.0, 0.0);
    }
    let total = reduce_eight(lane, sum);
    let row = params.first_group + g;
    if lane == 0u && g * LANES < params.points {
        sums[row] = total;
    }
}
