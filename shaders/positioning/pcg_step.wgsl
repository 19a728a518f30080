// The vector half of a PCG iteration, with the stop of an inexact Newton step: the last iteration improved the model by
// less than η of its mean improvement (Nash and Sofer; source: solver.md §5.2). One workgroup.

#import "positioning/pcg.wgsl"

@group(0) @binding(2) var<storage, read> topology: array<u32>;
@group(0) @binding(3) var<storage, read> partials: array<vec4f>;
@group(0) @binding(4) var<storage, read> sums: array<Eight>;

var<workgroup> is_done: u32;

@compute @workgroup_size(256)
fn position_pcg_step(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        is_done = select(0u, 1u, vectors[0].y != 0.0);
    }
    if workgroupUniformLoad(&is_done) == 1u {
        return;
    }
    let state = vectors[0];
    var squares = 0.0;
    var damped_squares = 0.0;
    for (var g = lane; g < settings.point_groups; g += LANES) {
        squares += sums[g].a.x;
    }
    for (var camera = lane; camera < settings.cameras; camera += LANES) {
        var sum = vec4f();
        for (var k = topology[camera]; k < topology[camera + 1u]; k += 1u) {
            sum += partials[topology[settings.cameras + 1u + k]];
        }
        let p = load(DIRECTION, camera);
        let damped = load(DIAGONAL, camera) * p;
        squares += sum.w;
        damped_squares += dot(damped, p);
        store(PRODUCT, camera, sum.xyz + settings.lambda * damped);
    }
    let curvatures = reduce_eight(lane, Eight(vec4f(squares, damped_squares, 0.0, 0.0), vec4f()));
    workgroupBarrier();
    // A sum of squares: not positive means that nothing is left of the direction.
    let curvature = curvatures.a.x + settings.lambda * curvatures.a.y;
    let alive = curvature > 0.0 && is_finite(curvature);
    let alpha = select(0.0, state.z / curvature, alive);
    var improved = 0.0;
    var rz = 0.0;
    var length = 0.0;
    for (var camera = lane; camera < settings.cameras; camera += LANES) {
        let x = load(X, camera) + alpha * load(DIRECTION, camera);
        let r = load(RESIDUAL, camera) - alpha * load(PRODUCT, camera);
        let z = precondition(camera, r);
        store(X, camera, x);
        store(RESIDUAL, camera, r);
        store(Z, camera, z);
        improved += dot(x, load(RHS, camera) + r);
        rz += dot(r, z);
        length += dot(x, load(DIAGONAL, camera) * x);
    }
    let total = reduce_eight(lane, Eight(vec4f(improved, rz, length, 0.0), vec4f()));
    let beta = total.a.y / state.z;
    for (var camera = lane; camera < settings.cameras; camera += LANES) {
        store(DIRECTION, camera, load(Z, camera) + beta * load(DIRECTION, camera));
    }
    if lane == 0u {
        let iterations = state.x + 1.0;
        let slow = iterations * (total.a.x - state.w) < settings.eta * total.a.x;
        let enough = iterations >= f32(settings.min_iterations) && slow;
        let left = iterations < f32(settings.max_iterations);
        let more = alive && total.a.y > 0.0 && is_finite(total.a.y) && left && !enough;
        vectors[0] = vec4f(iterations, select(1.0, 0.0, more), total.a.y, total.a.x);
        vectors[1] = vec4f(total.a.z, 0.0, 0.0, 0.0);
    }
}
