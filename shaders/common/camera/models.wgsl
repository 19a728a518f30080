// Every camera model: which file serves it, and what all share. Parameters fx, fy, cx, cy, then the distortion in COLMAP's
// order (source: algorithms.md §3.5); one focal length stands for both. All but EQUIRECTANGULAR depend on u = q.xy / q.z
// alone, so a point behind the camera is projected through the centre.

#import "common/unit.wgsl"
#import "common/camera/angles.wgsl"
#import "common/camera/polynomial.wgsl"
#import "common/camera/tilted.wgsl"
#import "common/camera/fov.wgsl"
#import "common/camera/division.wgsl"
#import "common/camera/eucm.wgsl"
#import "common/camera/equirectangular.wgsl"

// COLMAP's ids of the models that are not told apart by zeros among their parameters.
const OPENCV_FISHEYE = 5u;
const FULL_OPENCV = 6u;
const FOV = 7u;
const SIMPLE_RADIAL_FISHEYE = 8u;
const RADIAL_FISHEYE = 9u;
const THIN_PRISM_FISHEYE = 10u;
const RAD_TAN_THIN_PRISM_FISHEYE = 11u;
const SIMPLE_DIVISION = 12u;
const DIVISION = 13u;
const SIMPLE_FISHEYE = 14u;
const FISHEYE = 15u;
const EUCM = 16u;
const EQUIRECTANGULAR = 17u;

struct Intrinsics {
    params: Unit,
    // x: 1 where one focal length serves both axes (its unknown is fx's); y: the model; w: 1 where the preconditioner has
    // an exact block.
    kind: vec4u,
}

struct Projection {
    // By the point in the camera frame: two rows.
    x_by_q: vec3f,
    y_by_q: vec3f,
    // By the parameters: two rows.
    x_by_params: Unit,
    y_by_params: Unit,
}

fn is_fisheye(model: u32) -> bool {
    return model == OPENCV_FISHEYE || (model >= SIMPLE_RADIAL_FISHEYE && model <= RAD_TAN_THIN_PRISM_FISHEYE)
        || model == SIMPLE_FISHEYE || model == FISHEYE;
}

// Whether the model has a pixel for a point of the plane z = 1.
fn is_in_domain(k: Intrinsics, u: vec2f) -> bool {
    switch k.kind.y {
        case FULL_OPENCV: {
            return is_before_pole(lens_of(FULL_OPENCV, k.params), u);
        }
        case SIMPLE_DIVISION, DIVISION: {
            return division_square(k.params, u) > 0.0;
        }
        case EUCM: {
            return eucm_divisor(k.params, u) > 0.0;
        }
        default: {
            return true;
        }
    }
}

fn distort(k: Intrinsics, u: vec2f) -> vec2f {
    let model = k.kind.y;
    var point = u;
    if is_fisheye(model) {
        point = angles(u);
    }
    switch model {
        case FOV: {
            return distort_fov(k.params, point);
        }
        case RAD_TAN_THIN_PRISM_FISHEYE: {
            return distort_tilted(k.params, point);
        }
        case SIMPLE_DIVISION, DIVISION: {
            return distort_division(k.params, point);
        }
        case EUCM: {
            return distort_eucm(k.params, point);
        }
        default: {
            return distort_polynomial(lens_of(model, k.params), point);
        }
    }
}

fn differentiate_distortion(k: Intrinsics, u: vec2f) -> Distorted {
    let model = k.kind.y;
    var point = u;
    if is_fisheye(model) {
        point = angles(u);
    }
    var out: Distorted;
    switch model {
        case FOV: {
            out = differentiate_fov(k.params, point);
        }
        case RAD_TAN_THIN_PRISM_FISHEYE: {
            out = differentiate_tilted(k.params, point);
        }
        case SIMPLE_DIVISION, DIVISION: {
            out = differentiate_division(k.params, point);
        }
        case EUCM: {
            out = differentiate_eucm(k.params, point);
        }
        default: {
            out = differentiate_polynomial(model, lens_of(model, k.params), point);
        }
    }
    if is_fisheye(model) {
        out = from_plane(out, u);
    }
    return out;
}

fn change_distortion(k: Intrinsics, change: Unit, u: vec2f, du: vec2f) -> vec2f {
    let model = k.kind.y;
    var x = changed(u.x, du.x);
    var y = changed(u.y, du.y);
    if is_fisheye(model) {
        let ratio = ratio_of(x, y);
        x = times(ratio, x);
        y = times(ratio, y);
    }
    switch model {
        case FOV: {
            return change_fov(k.params, change, x, y);
        }
        case RAD_TAN_THIN_PRISM_FISHEYE: {
            return change_tilted(k.params, change, x, y);
        }
        case SIMPLE_DIVISION, DIVISION: {
            return change_division(k.params, change, x, y);
        }
        case EUCM: {
            return change_eucm(k.params, change, x, y);
        }
        default: {
            return change_polynomial(lens_of(model, k.params), lens_of(model, change), x, y);
        }
    }
}

// Projection minus pixel; the principal point goes first, so that large numbers cancel before small ones are lost.
fn project_residual(k: Intrinsics, q: vec3f, pixel: vec2f) -> vec2f {
    if k.kind.y == EQUIRECTANGULAR {
        return sphere_residual(k.params, q, pixel);
    }
    return k.params.a.xy * distort(k, q.xy / q.z) + (k.params.a.zw - pixel);
}

fn differentiate(k: Intrinsics, q: vec3f) -> Projection {
    let f = k.params.a.xy;
    var out: Projection;
    if k.kind.y == EQUIRECTANGULAR {
        let sphere = differentiate_sphere(q);
        out.x_by_q = f.x * sphere.x_by_q;
        out.y_by_q = f.y * sphere.y_by_q;
        out.x_by_params.a.x = sphere.share.x;
        out.y_by_params.a.y = sphere.share.y;
        return out;
    }
    let inverse_z = 1.0 / q.z;
    let u = q.xy * inverse_z;
    let d = differentiate_distortion(k, u);
    out.x_by_q = (f.x * inverse_z) * vec3f(d.x_by_point, -dot(d.x_by_point, u));
    out.y_by_q = (f.y * inverse_z) * vec3f(d.y_by_point, -dot(d.y_by_point, u));
    out.x_by_params = scale_unit(f.x, d.x_by_params);
    out.y_by_params = scale_unit(f.y, d.y_by_params);
    out.x_by_params.a = vec4f(d.point.x, 0.0, 1.0, 0.0);
    out.y_by_params.a = select(vec4f(0.0, d.point.y, 0.0, 1.0), vec4f(d.point.y, 0.0, 0.0, 1.0), k.kind.x == 1u);
    return out;
}

// Change of the pixel for a change of parameters and point, every term in proportion to the change
// (source: solver.md §1.3 d).
fn project_change(k: Intrinsics, change: Intrinsics, q: vec3f, dq: vec3f) -> vec2f {
    if k.kind.y == EQUIRECTANGULAR {
        return sphere_change(k.params, change.params, q, dq);
    }
    let u = q.xy / q.z;
    let du = (dq.xy - u * dq.z) / (q.z + dq.z);
    let after = Intrinsics(add_units(k.params, change.params), k.kind);
    return change.params.a.xy * distort(after, u + du)
        + k.params.a.xy * change_distortion(k, change.params, u, du)
        + change.params.a.zw;
}
