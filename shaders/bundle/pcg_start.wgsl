// Starts PCG at x = 0. One workgroup.

#import "bundle/pcg.wgsl"

@compute @workgroup_size(256)
fn pcg_start(@builtin(local_invocation_index) lane: u32) {
    let units = params.images + params.cameras;
    for (var unit = lane; unit < units; unit += LANES) {
        store(X, unit, no_unit());
        store(RESIDUAL, unit, load(RHS, unit));
    }
    storageBarrier();
    solve_coarse(lane);
    var rz = 0.0;
    for (var unit = lane; unit < units; unit += LANES) {
        let z = precondition(unit);
        store(DIRECTION, unit, z);
        store(SCALED, unit, multiply_units(load(SCALE, unit), z));
        rz += dot_units(load(RESIDUAL, unit), z);
    }
    let total = reduce_eight(lane, Eight(vec4f(rz, 0.0, 0.0, 0.0), vec4f()));
    if lane == 0u {
        let good = total.a.x > 0.0 && is_finite(total.a.x);
        vectors[0] = vec4f(0.0, select(1.0, 0.0, good), total.a.x, 0.0);
        vectors[1] = vec4f();
    }
}
