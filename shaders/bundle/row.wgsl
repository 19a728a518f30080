// An observation's derivatives, multiplied by the root of its weight, computed where they are needed
// (source: solver.md §2.3). Rotations are updated in the world frame: dr = J_p (δX − δC + ω×t) + J_k δk.

#import "bundle/types.wgsl"

struct Row {
    // By the point: two rows.
    px: vec3f,
    py: vec3f,
#if depth
    // And that of the inverse depth, which does not depend on the camera parameters; zero where it is unknown.
    pz: vec3f,
#endif
    // X − C in the world frame.
    ray: vec3f,
    // By the camera parameters: two rows.
    x_params: Unit,
    y_params: Unit,
}

fn row_of(point: Point, view: View, intrinsics: Intrinsics, cell: f32, weights: Weights) -> Row {
    let ray = ray_to(point, view, cell);
    let q = rotate(view, ray);
    let p = differentiate(intrinsics, q);
    var row = Row();
#if depth
    let weight = weights.x;
    if weights.y != 0.0 {
        row.pz = -(weights.y / (q.z * q.z)) * view.r2.xyz;
    }
#else
    let weight = weights;
#endif
    row.px = weight * (p.x_by_q.x * view.r0.xyz + p.x_by_q.y * view.r1.xyz + p.x_by_q.z * view.r2.xyz);
    row.py = weight * (p.y_by_q.x * view.r0.xyz + p.y_by_q.y * view.r1.xyz + p.y_by_q.z * view.r2.xyz);
    row.ray = ray;
    row.x_params = scale_unit(weight, p.x_by_params);
    row.y_params = scale_unit(weight, p.y_by_params);
    return row;
}

// Errors multiplied by the roots of their weights.
fn weighted(weights: Weights, e: Errors) -> Errors {
#if depth
    return weights.xxy * e;
#else
    return weights * e;
#endif
}

// J_p y.
fn point_product(row: Row, y: vec3f) -> Errors {
    return Errors(
        dot(row.px, y),
        dot(row.py, y),
#if depth
        dot(row.pz, y),
#endif
    );
}

// J_pᵀ e.
fn point_transposed(row: Row, e: Errors) -> vec3f {
    let sum = row.px * e.x + row.py * e.y;
#if depth
    return sum + row.pz * e.z;
#else
    return sum;
#endif
}

// J_pᵀ J_p.
fn point_square(row: Row) -> mat3x3f {
    let sum = mat3x3f(
        row.px.x * row.px + row.py.x * row.py,
        row.px.y * row.px + row.py.y * row.py,
        row.px.z * row.px + row.py.z * row.py,
    );
#if depth
    return sum + mat3x3f(row.pz.x * row.pz, row.pz.y * row.pz, row.pz.z * row.pz);
#else
    return sum;
#endif
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
fn camera_product(row: Row, x: CameraStep) -> Errors {
    let moved = cross(x.a.xyz, row.ray) - vec3f(x.a.w, x.b.xy);
    return Errors(
        add_dot_units(dot(row.px, moved), row.x_params, x.params),
        add_dot_units(dot(row.py, moved), row.y_params, x.params),
#if depth
        dot(row.pz, moved),
#endif
    );
}

// J_cᵀ e; the unused b.z carries ‖e‖².
fn camera_transposed(row: Row, e: Errors) -> CameraStep {
    let g = point_transposed(row, e);
    let rotation = cross(row.ray, g);
    return CameraStep(
        vec4f(rotation, -g.x),
        vec4f(-g.yz, dot(e, e), 0.0),
        add_units(scale_unit(e.x, row.x_params), scale_unit(e.y, row.y_params)),
    );
}
