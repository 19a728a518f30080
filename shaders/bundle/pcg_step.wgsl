// The vector half of a PCG iteration, with the stop of an inexact Newton step: the last iteration improved the model by
// less than η of its mean improvement (Nash and Sofer; source: solver.md §5.2). One workgroup.

#import "bundle/pcg.wgsl"

@group(0) @binding(6) var<storage, read> partials: array<CameraStep>;
@group(0) @binding(7) var<storage, read> sums: array<Eight>;

var<workgroup> is_done: u32;

// One image's part of J_cᵀ v⊥ by its camera's parameters.
fn camera_part(image: u32) -> Unit {
    var sum = no_unit();
    for (var s = topology[image]; s < topology[image + 1u]; s += 1u) {
        sum = add_units(sum, partials[s].params);
    }
    return sum;
}

// The tree's eighth number is a maximum: four sums go at a time.
fn reduce_four(lane: u32, value: vec4f) -> vec4f {
    let total = reduce_eight(lane, Eight(value, vec4f()));
    workgroupBarrier();
    return total.a;
}

// Scales a sum, adds damping and priors, and keeps it. Returns their share of the direction's square.
fn finish_product(unit: u32, sum: Unit) -> f32 {
    let p = load(DIRECTION, unit);
    let damped = add_units(scale_unit(params.lambda, p), multiply_units(load(PRIOR_DIAGONAL, unit), p));
    store(PRODUCT, unit, add_units(multiply_units(load(SCALE, unit), sum), damped));
    return dot_units(p, damped);
}

@compute @workgroup_size(256)
fn pcg_step(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        is_done = select(0u, 1u, vectors[0].y != 0.0);
    }
    if workgroupUniformLoad(&is_done) == 1u {
        return;
    }
    let units = params.images + params.cameras;
    let state = vectors[0];
    var squares = 0.0;
    var direction_squares = 0.0;
    for (var g = lane; g < params.point_groups; g += LANES) {
        squares += sums[g].a.x;
    }
    for (var image = lane; image < params.images; image += LANES) {
        var sum = short_unit(vec4f(), vec4f());
        for (var s = topology[image]; s < topology[image + 1u]; s += 1u) {
            sum.a += partials[s].a;
            sum.b += partials[s].b;
        }
        squares += sum.b.z;
        direction_squares += finish_product(image, short_unit(sum.a, vec4f(sum.b.xy, 0.0, 0.0)));
    }
    for (var camera = lane; camera < params.cameras; camera += LANES) {
        let at = cameras_at(params.images) + camera;
        if topology[at + 1u] - topology[at] <= FEW_IMAGES {
            var sum = no_unit();
            for (var m = topology[at]; m < topology[at + 1u]; m += 1u) {
                sum = add_units(sum, camera_part(topology[members_at(params.images, params.cameras) + m]));
            }
            direction_squares += finish_product(params.images + camera, sum);
        }
    }
    for (var big = 0u; big < params.big_cameras; big += 1u) {
        let camera = topology[big_at(params.images, params.cameras) + big];
        let at = cameras_at(params.images) + camera;
        var sum = no_unit();
        for (var m = topology[at] + lane; m < topology[at + 1u]; m += LANES) {
            sum = add_units(sum, camera_part(topology[members_at(params.images, params.cameras) + m]));
        }
        var total = no_unit();
        total.a = reduce_four(lane, sum.a);
        total.b = reduce_four(lane, sum.b);
#if wide
        total.c = reduce_four(lane, sum.c);
        total.d = reduce_four(lane, sum.d);
#endif
        if lane == 0u {
            direction_squares += finish_product(params.images + camera, total);
        }
    }
    storageBarrier();
    let curvatures = reduce_eight(lane, Eight(vec4f(squares, direction_squares, 0.0, 0.0), vec4f()));
    workgroupBarrier();
    // A sum of squares: not positive means that nothing is left of the direction.
    let curvature = curvatures.a.x + curvatures.a.y;
    let alive = curvature > 0.0 && is_finite(curvature);
    let alpha = select(0.0, state.z / curvature, alive);
    for (var unit = lane; unit < units; unit += LANES) {
        store(X, unit, add_units(load(X, unit), scale_unit(alpha, load(DIRECTION, unit))));
        store(RESIDUAL, unit, add_units(load(RESIDUAL, unit), scale_unit(-alpha, load(PRODUCT, unit))));
    }
    storageBarrier();
    solve_coarse(lane);
    var improved = 0.0;
    var rz = 0.0;
    var length = 0.0;
    var largest = 0.0;
    for (var unit = lane; unit < units; unit += LANES) {
        let z = precondition(unit);
        let x = load(X, unit);
        let r = load(RESIDUAL, unit);
        store(Z, unit, z);
        improved += dot_units(x, add_units(load(RHS, unit), r));
        rz += dot_units(r, z);
        length += dot_units(x, x);
        largest = max(largest, largest_of(x));
    }
    let total = reduce_eight(lane, Eight(vec4f(improved, rz, length, 0.0), vec4f(0.0, 0.0, 0.0, largest)));
    let beta = total.a.y / state.z;
    for (var unit = lane; unit < units; unit += LANES) {
        let next = add_units(load(Z, unit), scale_unit(beta, load(DIRECTION, unit)));
        store(DIRECTION, unit, next);
        store(SCALED, unit, multiply_units(load(SCALE, unit), next));
    }
    storageBarrier();
    if lane == 0u {
        let iterations = state.x + 1.0;
        let slow = iterations * (total.a.x - state.w) < params.eta * total.a.x;
        let enough = iterations >= f32(params.min_iterations) && slow;
        let more = alive && total.a.y > 0.0 && is_finite(total.a.y) && iterations < f32(params.max_iterations) && !enough;
        vectors[0] = vec4f(iterations, select(1.0, 0.0, more), total.a.y, total.a.x);
        vectors[1] = vec4f(total.a.z, total.b.w, 0.0, 0.0);
    }
}
