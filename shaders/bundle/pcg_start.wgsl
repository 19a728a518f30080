// Starts PCG at x = 0. One workgroup.

#import "bundle/pcg.wgsl"

@compute @workgroup_size(256)
fn pcg_start(@builtin(local_invocation_index) lane: u32) {
    let units = params.images + params.cameras;
    let zero = Unit(vec4f(), vec4f());
    for (var unit = lane; unit < units; unit += LANES) {
        store(X, unit, zero);
        store(RESIDUAL, unit, load(RHS, unit));
    }
    storageBarrier();
    var rz = 0.0;
    for (var unit = lane; unit < units; unit += LANES) {
        let z = precondition(unit);
        let scale = load(SCALE, unit);
        store(DIRECTION, unit, z);
        store(SCALED, unit, Unit(scale.a * z.a, scale.b * z.b));
        rz += dot_unit(load(RESIDUAL, unit), z);
    }
    let total = reduce_eight(lane, Eight(vec4f(rz, 0.0, 0.0, 0.0), vec4f()));
    if lane == 0u {
        let good = total.a.x > 0.0 && is_finite(total.a.x);
        vectors[0] = vec4f(0.0, select(1.0, 0.0, good), total.a.x, 0.0);
        vectors[1] = vec4f();
    }
}
