// An observation's derivatives, multiplied by the root of its weight, computed where they are needed
// (source: solver.md §2.3). Rotations are updated in the world frame: dr = J_p (δX − δC + ω×t) + J_k δk.

#import "bundle/types.wgsl"

struct Row {
    // By the point: two rows.
    px: vec3f,
    py: vec3f,
    // X − C in the world frame.
    ray: vec3f,
    // By the eight camera parameters: two rows.
    x_linear: vec4f,
    x_distortion: vec4f,
    y_linear: vec4f,
    y_distortion: vec4f,
}

fn row_of(point: Point, view: View, intrinsics: Intrinsics, cell: f32, weight: f32) -> Row {
    let ray = ray_to(point, view, cell);
    let p = differentiate(intrinsics, rotate(view, ray));
    var row: Row;
    row.px = weight * (p.x_by_q.x * view.r0.xyz + p.x_by_q.y * view.r1.xyz + p.x_by_q.z * view.r2.xyz);
    row.py = weight * (p.y_by_q.x * view.r0.xyz + p.y_by_q.y * view.r1.xyz + p.y_by_q.z * view.r2.xyz);
    row.ray = ray;
    row.x_linear = weight * p.x_by_linear;
    row.x_distortion = weight * p.x_by_distortion;
    row.y_linear = weight * p.y_by_linear;
    row.y_distortion = weight * p.y_by_distortion;
    return row;
}

// A step of pose and camera: rotation and centre in four and two numbers, then the parameters.
struct CameraStep {
    a: vec4f,
    b: vec4f,
    linear: vec4f,
    distortion: vec4f,
}

// J_c x.
fn camera_product(row: Row, x: CameraStep) -> vec2f {
    let moved = cross(x.a.xyz, row.ray) - vec3f(x.a.w, x.b.xy);
    return vec2f(
        dot(row.px, moved) + dot(row.x_linear, x.linear) + dot(row.x_distortion, x.distortion),
        dot(row.py, moved) + dot(row.y_linear, x.linear) + dot(row.y_distortion, x.distortion),
    );
}

// J_cᵀ e; the unused b.z carries ‖e‖².
fn camera_transposed(row: Row, e: vec2f) -> CameraStep {
    let g = row.px * e.x + row.py * e.y;
    let rotation = cross(row.ray, g);
    return CameraStep(
        vec4f(rotation, -g.x),
        vec4f(-g.yz, dot(e, e), 0.0),
        row.x_linear * e.x + row.y_linear * e.y,
        row.x_distortion * e.x + row.y_distortion * e.y,
    );
}
