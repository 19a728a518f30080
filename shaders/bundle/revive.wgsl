// Points that lost most of their observations are triangulated again: the position nearest to the rays, then Gauss–Newton
// steps, taken only if the point's share of the objective falls (source: solver.md §5.4). As
// crates/optimize/src/bundle/cpu/revive.rs, but the rays ignore distortion: they only say where to begin.

#import "common/dispatch.wgsl"
#import "bundle/cost.wgsl"
#import "bundle/sight.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"

const STEPS = 8u;
// Damping of those steps: only against nearly parallel rays.
const LAMBDA = 1e-6;
// Least gain in units of τ.
const LEAST_GAIN = 0.1;
const RANK_RATIO = 1e6;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read_write> points: array<Point>;
@group(0) @binding(4) var<storage, read> tracks: array<u32>;
@group(0) @binding(5) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(6) var<storage, read> pixels: array<vec2f>;
@group(0) @binding(7) var<storage, read_write> residuals: array<Residual>;

// What an observation is charged for a residual.
fn charge(o: u32, image: u32, r: Errors) -> f32 {
    let was_active = (by_point[o].image & OUT) == 0u;
    let worth = worth_of(residuals[o], r);
    let limit = params.tau * select(RETURN_SHARE, 1.0, was_active);
    let enters = was_active || is_inside(limits_of(image, params.images), pixels[o] + r.xy);
    return select(params.tau, worth, r.x != INVALID && worth < limit && enters);
}

fn errors_at(o: u32, image: u32, camera: u32, q: vec3f) -> Errors {
    let k = intrinsics[camera];
    if is_seen(k, limits_of(image, params.images), q, params.activation) {
        let e = add_depth_error(residuals[o], project_residual(k, q, pixels[o]), q.z);
        if has_finite_depth(residuals[o], e) {
            return e;
        }
    }
    return invalid();
}

// The unit ray of a pixel in the camera frame, as if there were no distortion.
fn ray_of(k: Intrinsics, pixel: vec2f) -> vec3f {
#if wide
    if k.kind.y == EQUIRECTANGULAR {
        let turn = (pixel / k.params.a.xy - 0.5) * vec2f(6.2831853, 3.1415927);
        return vec3f(sin(turn.x) * cos(turn.y), sin(turn.y), cos(turn.x) * cos(turn.y));
    }
    if is_fisheye(k.kind.y) {
        let bent = (pixel - k.params.a.zw) / k.params.a.xy;
        let angle = length(bent);
        return vec3f(bent * select(1.0, sin(angle) / angle, angle > 1e-6), cos(angle));
    }
#endif
    return normalize(vec3f((pixel - k.params.a.zw) / k.params.a.xy, 1.0));
}

// Where a centre lies from that of another image.
fn between(view: View, from_view: View) -> vec3f {
    let cells = params.cell * vec3f(view.cell - from_view.cell);
    return cells + (vec3f(view.r0.w, view.r1.w, view.r2.w) - vec3f(from_view.r0.w, from_view.r1.w, from_view.r2.w));
}

// A position given from a centre, in the lattice.
fn placed(view: View, from_center: vec3f) -> Point {
    let offset = from_center + vec3f(view.r0.w, view.r1.w, view.r2.w);
    let cells = vec3i(clamp(round(offset / params.cell), vec3f(-2e6), vec3f(2e6)));
    let target_cell = clamp(view.cell + cells, vec3i(0), vec3i(1023));
    let rest = offset - params.cell * vec3f(target_cell - view.cell);
    let packed = vec3u(target_cell);
    return Point(rest.x, rest.y, rest.z, packed.x | (packed.y << 10u) | (packed.z << 20u), vec3f(), 0.0);
}

@compute @workgroup_size(64)
fn revive(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p >= params.points || params.fixed_points == 1u {
        return;
    }
    let start = tracks[p];
    let end = tracks[p + 1u];
    var visible = 0u;
    var counting = 0u;
    var first = 0u;
    for (var o = start; o < end; o += 1u) {
        let word = by_point[o].image;
        if (word & HIDDEN) == 0u {
            first = select(first, word & IMAGE_MASK, visible == 0u);
            visible += 1u;
            counting += select(0u, 1u, (word & OUT) == 0u);
        }
    }
    let poor = counting < 2u || 2u * counting < visible;
    if visible < 2u || !(poor || (params.revive_all == 1u && counting < visible)) {
        return;
    }
    let origin = views[first];
    // What the point costs where it is, and the sum of squared distances to the rays as normal equations.
    var best = -LEAST_GAIN * params.tau;
    var a = vec3f();
    var b = vec3f();
    var rhs = vec3f();
    let point = points[p];
    for (var o = start; o < end; o += 1u) {
        if (by_point[o].image & HIDDEN) != 0u {
            continue;
        }
        let image = by_point[o].image & IMAGE_MASK;
        let view = views[image];
        let k = intrinsics[view.camera];
        best += charge(o, image, errors_at(o, image, view.camera, rotate(view, ray_to(point, view, params.cell))));
        let ray = ray_of(k, pixels[o]);
        let d = ray.x * view.r0.xyz + ray.y * view.r1.xyz + ray.z * view.r2.xyz;
        let c = between(view, origin);
        a += vec3f(1.0) - d * d;
        b -= vec3f(d.x * d.y, d.x * d.z, d.y * d.z);
        rhs += c - d * dot(d, c);
    }
    // Cofactors of the symmetric matrix (a.x b.x b.y; b.x a.y b.z; b.y b.z a.z).
    let c0 = vec3f(a.y * a.z - b.z * b.z, b.y * b.z - b.x * a.z, b.x * b.z - b.y * a.y);
    let c1 = vec3f(c0.y, a.x * a.z - b.y * b.y, b.x * b.y - a.x * b.z);
    let c2 = vec3f(c0.z, c1.z, a.x * a.y - b.x * b.x);
    let determinant = a.x * c0.x + b.x * c0.y + b.y * c0.z;
    if !(determinant > 1e-12) {
        return;
    }
    var v = vec3f(dot(c0, rhs), dot(c1, rhs), dot(c2, rhs)) / determinant;
    var best_v = v;
    var improved = false;
    for (var step = 0u; step <= STEPS; step += 1u) {
        var cost = 0.0;
        var used = 0u;
        var r = Triangle(vec3f(), vec3f());
        var gradient = vec3f();
        for (var o = start; o < end; o += 1u) {
            if (by_point[o].image & HIDDEN) != 0u {
                continue;
            }
            let image = by_point[o].image & IMAGE_MASK;
            let view = views[image];
            let q = rotate(view, v - between(view, origin));
            let e = errors_at(o, image, view.camera, q);
            cost += charge(o, image, e);
            let s = dot(e.xy, e.xy);
            let within = loss_value(params.loss, params.loss_scale, s) < params.tau;
            if e.x == INVALID || (step > STEPS / 2u && !within) {
                continue;
            }
            let d = differentiate(intrinsics[view.camera], q);
            let weight = sqrt(loss_weight(params.loss, params.loss_scale, s));
            let px = weight * (d.x_by_q.x * view.r0.xyz + d.x_by_q.y * view.r1.xyz + d.x_by_q.z * view.r2.xyz);
            let py = weight * (d.y_by_q.x * view.r0.xyz + d.y_by_q.y * view.r1.xyz + d.y_by_q.z * view.r2.xyz);
            r = fold_row(r, px);
            r = fold_row(r, py);
            gradient += weight * (px * e.x + py * e.y);
            used += 1u;
        }
        if cost < best {
            best = cost;
            best_v = v;
            improved = true;
        }
        let diagonal = abs(vec3f(r.top.x, r.bottom.x, r.bottom.z));
        let low = min(diagonal.x, min(diagonal.y, diagonal.z));
        let high = max(diagonal.x, max(diagonal.y, diagonal.z));
        if used < 2u || !(low * RANK_RATIO > high) {
            break;
        }
        let root = sqrt(LAMBDA) * sqrt(vec3f(
            r.top.x * r.top.x,
            r.top.y * r.top.y + r.bottom.x * r.bottom.x,
            r.top.z * r.top.z + r.bottom.y * r.bottom.y + r.bottom.z * r.bottom.z,
        ));
        r = fold_row(r, vec3f(root.x, 0.0, 0.0));
        r = fold_row(r, vec3f(0.0, root.y, 0.0));
        r = fold_row(r, vec3f(0.0, 0.0, root.z));
        var block = Block(vec4f(), vec4f(), vec4f(), vec4f(), vec4f(), vec4f());
        block.damped_top = vec4f(1.0 / r.top.x, r.top.yz, 0.0);
        block.damped_bottom = vec4f(1.0 / r.bottom.x, r.bottom.y, 1.0 / r.bottom.z, 0.0);
        v -= solve_normal(block, gradient);
        if !(is_finite(v.x) && is_finite(v.y) && is_finite(v.z)) {
            break;
        }
    }
    if !improved {
        return;
    }
    let moved = placed(origin, best_v);
    points[p] = moved;
    for (var o = start; o < end; o += 1u) {
        let image = by_point[o].image & IMAGE_MASK;
        let view = views[image];
        let e = errors_at(o, image, view.camera, rotate(view, ray_to(moved, view, params.cell)));
        residuals[o] = with_errors(residuals[o], e, e);
    }
}
