// An observation's derivatives, multiplied by the root of its weight, computed where they are needed
// (source: solver.md §2.3). Rotations are updated in the world frame: dr = J_p (δX − δC + ω×t) + J_k δk.

#import "bundle/types.wgsl"

struct Row {
    // By the point: two rows.
    px: vec3f,
    py: vec3f,
    // X − C in the world frame.
    ray: vec3f,
    // By the camera parameters: two rows.
    x_params: Unit,
    y_params: Unit,
}

fn row_of(point: Point, view: View, intrinsics: Intrinsics, cell: f32, weight: f32) -> Row {
    let ray = ray_to(point, view, cell);
    let p = differentiate(intrinsics, rotate(view, ray));
    var row: Row;
    row.px = weight * (p.x_by_q.x * view.r0.xyz + p.x_by_q.y * view.r1.xyz + p.x_by_q.z * view.r2.xyz);
    row.py = weight * (p.y_by_q.x * view.r0.xyz + p.y_by_q.y * view.r1.xyz + p.y_by_q.z * view.r2.xyz);
    row.ray = ray;
    row.x_params = scale_unit(weight, p.x_by_params);
    row.y_params = scale_unit(weight, p.y_by_params);
    return row;
}

// A step of pose and camera: rotation and centre in four and two numbers, then the parameters.
struct CameraStep {
    a: vec4f,
    b: vec4f,
    params: Unit,
}

fn no_step() -> CameraStep {
    return CameraStep(vec4f(), vec4f(), no_unit());
}

// J_c x.
fn camera_product(row: Row, x: CameraStep) -> vec2f {
    let moved = cross(x.a.xyz, row.ray) - vec3f(x.a.w, x.b.xy);
    return vec2f(
        add_dot_units(dot(row.px, moved), row.x_params, x.params),
        add_dot_units(dot(row.py, moved), row.y_params, x.params),
    );
}

// J_cᵀ e; the unused b.z carries ‖e‖².
fn camera_transposed(row: Row, e: vec2f) -> CameraStep {
    let g = row.px * e.x + row.py * e.y;
    let rotation = cross(row.ray, g);
    return CameraStep(
        vec4f(rotation, -g.x),
        vec4f(-g.yz, dot(e, e), 0.0),
        add_units(scale_unit(e.x, row.x_params), scale_unit(e.y, row.y_params)),
    );
}
