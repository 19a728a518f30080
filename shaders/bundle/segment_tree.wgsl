// Sums of camera-sized values over a workgroup of 64, in a tree of fixed shape.

#import "bundle/row.wgsl"

var<workgroup> tree_step: array<CameraStep, 64>;

fn add_steps(x: CameraStep, y: CameraStep) -> CameraStep {
    return CameraStep(x.a + y.a, x.b + y.b, add_units(x.params, y.params));
}

// Must be reached by all lanes.
fn reduce_step(lane: u32, value: CameraStep) -> CameraStep {
    tree_step[lane] = value;
    for (var stride = 32u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            let x = tree_step[lane];
            let y = tree_step[lane + stride];
            tree_step[lane] = add_steps(x, y);
        }
    }
    workgroupBarrier();
    return tree_step[0];
}
