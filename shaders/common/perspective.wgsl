// The pinhole and radial families and OPENCV as one model: parameters fx, fy, cx, cy, k1, k2, p1, p2, absent ones 0
// (source: algorithms.md §3.5, solver.md §1.1). Everything depends on u = q.xy / q.z alone, so a point behind the camera
// is projected through the centre.

#import "common/unit.wgsl"

struct Intrinsics {
    // fx, fy, cx, cy; k1, k2, p1, p2.
    params: Unit,
    // x: 1 where one focal length serves both axes (its unknown is fx's); w: 1 where the preconditioner has an exact block
    kind: vec4u,
}

struct Projection {
    // By the point in the camera frame: two rows.
    x_by_q: vec3f,
    y_by_q: vec3f,
    // By the eight parameters: two rows.
    x_by_params: Unit,
    y_by_params: Unit,
}

fn distorted(k: vec4f, u: vec2f) -> vec2f {
    let n = dot(u, u);
    let d = 1.0 + n * (k.x + k.y * n);
    let xy = 2.0 * u.x * u.y;
    return d * u + vec2f(k.z * xy + k.w * (n + 2.0 * u.x * u.x), k.w * xy + k.z * (n + 2.0 * u.y * u.y));
}

// Projection minus pixel; the principal point goes first, so that large numbers cancel before small ones are lost.
fn project_residual(k: Intrinsics, q: vec3f, pixel: vec2f) -> vec2f {
    return k.params.a.xy * distorted(k.params.b, q.xy / q.z) + (k.params.a.zw - pixel);
}

fn differentiate(k: Intrinsics, q: vec3f) -> Projection {
    let inverse_z = 1.0 / q.z;
    let u = q.xy * inverse_z;
    let n = dot(u, u);
    let c = k.params.b;
    let d = 1.0 + n * (c.x + c.y * n);
    let slope = 2.0 * (c.x + 2.0 * c.y * n);
    let mixed = slope * u.x * u.y + 2.0 * (c.z * u.x + c.w * u.y);
    let by_x = vec2f(d + slope * u.x * u.x + 2.0 * c.z * u.y + 6.0 * c.w * u.x, mixed) * k.params.a.x;
    let by_y = vec2f(mixed, d + slope * u.y * u.y + 2.0 * c.w * u.x + 6.0 * c.z * u.y) * k.params.a.y;
    let point = distorted(c, u);
    let xy = 2.0 * u.x * u.y;
    let single = k.kind.x == 1u;
    var out: Projection;
    out.x_by_q = vec3f(by_x, -dot(by_x, u)) * inverse_z;
    out.y_by_q = vec3f(by_y, -dot(by_y, u)) * inverse_z;
    let y_linear = select(vec4f(0.0, point.y, 0.0, 1.0), vec4f(point.y, 0.0, 0.0, 1.0), single);
    let x_distortion = k.params.a.x * vec4f(n * u.x, n * n * u.x, xy, n + 2.0 * u.x * u.x);
    let y_distortion = k.params.a.y * vec4f(n * u.y, n * n * u.y, n + 2.0 * u.y * u.y, xy);
    out.x_by_params = Unit(vec4f(point.x, 0.0, 1.0, 0.0), x_distortion);
    out.y_by_params = Unit(y_linear, y_distortion);
    return out;
}

// Change of the pixel for a change of parameters and point, every term in proportion to the change
// (source: solver.md §1.3 d).
fn project_change(k: Intrinsics, change: Intrinsics, q: vec3f, dq: vec3f) -> vec2f {
    let u = q.xy / q.z;
    let du = (dq.xy - u * dq.z) / (q.z + dq.z);
    let u2 = u + du;
    let n = dot(u, u);
    let dn = dot(du, 2.0 * u + du);
    let n2 = n + dn;
    let c = k.params.b;
    let dc = change.params.b;
    let d = 1.0 + n * (c.x + c.y * n);
    let dd = dc.x * n2 + c.x * dn + dc.y * n2 * n2 + c.y * dn * (n + n2);
    let dxy = 2.0 * (du.x * u2.y + u.x * du.y);
    let dxx = 2.0 * du.x * (2.0 * u.x + du.x);
    let dyy = 2.0 * du.y * (2.0 * u.y + du.y);
    let xy2 = 2.0 * u2.x * u2.y;
    let moved = dd * u2 + d * du + vec2f(
        dc.z * xy2 + c.z * dxy + dc.w * (n2 + 2.0 * u2.x * u2.x) + c.w * (dn + dxx),
        dc.w * xy2 + c.w * dxy + dc.z * (n2 + 2.0 * u2.y * u2.y) + c.z * (dn + dyy),
    );
    return change.params.a.xy * distorted(c + dc, u2) + k.params.a.xy * moved + change.params.a.zw;
}
