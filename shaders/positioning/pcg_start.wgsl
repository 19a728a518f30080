// Starts PCG at x = 0. One workgroup.

#import "positioning/pcg.wgsl"

@compute @workgroup_size(256)
fn position_pcg_start(@builtin(local_invocation_index) lane: u32) {
    var rz = 0.0;
    for (var camera = lane; camera < settings.cameras; camera += LANES) {
        let r = load(RHS, camera);
        let z = precondition(camera, r);
        store(X, camera, vec3f());
        store(RESIDUAL, camera, r);
        store(DIRECTION, camera, z);
        rz += dot(r, z);
    }
    let total = reduce_eight(lane, Eight(vec4f(rz, 0.0, 0.0, 0.0), vec4f()));
    if lane == 0u {
        let good = total.a.x > 0.0 && is_finite(total.a.x);
        vectors[0] = vec4f(0.0, select(1.0, 0.0, good), total.a.x, 0.0);
        vectors[1] = vec4f();
    }
}
