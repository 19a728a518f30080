// RAD_TAN_THIN_PRISM_FISHEYE, in angles: k0..k5 scale the point; p0, p1 and s0..s3 tilt what comes out of that
// (source: algorithms.md §3.5). Its tangential parameters are named the other way round than those of OPENCV.

#import "common/camera/polynomial.wgsl"

// k0..k5 as two polynomials: the second counts from n⁵ on.
fn tilted_factor(k: Unit, n: f32) -> vec2f {
    let low = polynomial(k.b, n);
    let n4 = n * n * n * n;
    let high = n * (k.c.x + k.c.y * n);
    let high_slope = 5.0 * k.c.x + 6.0 * k.c.y * n;
    return vec2f(1.0 + low.x + n4 * high, low.y + n4 * high_slope);
}

fn distort_tilted(k: Unit, a: vec2f) -> vec2f {
    let u = tilted_factor(k, dot(a, a)).x * a;
    let n = dot(u, u);
    return u + tangential(k.c.wz, u, n) + n * (k.d.xz + n * k.d.yw);
}

fn differentiate_tilted(k: Unit, a: vec2f) -> Distorted {
    let s = dot(a, a);
    let factor = tilted_factor(k, s);
    let u = factor.x * a;
    let n = dot(u, u);
    let sides = tangential_slope(k.c.wz, u);
    let prism = 2.0 * (k.d.xz + 2.0 * n * k.d.yw);
    let xy = 2.0 * u.x * u.y;
    var out: Distorted;
    out.point = u + tangential(k.c.wz, u, n) + n * (k.d.xz + n * k.d.yw);
    // By u, then by a.
    let x_by_u = vec2f(1.0, 0.0) + sides.xy + prism.x * u;
    let y_by_u = vec2f(0.0, 1.0) + sides.zw + prism.y * u;
    let along = 2.0 * factor.y * a;
    out.x_by_point = factor.x * x_by_u + dot(x_by_u, a) * along;
    out.y_by_point = factor.x * y_by_u + dot(y_by_u, a) * along;
    let powers = s * vec4f(1.0, s, s * s, s * s * s);
    let last = powers.w * vec2f(s, s * s);
    let x = dot(x_by_u, a);
    let y = dot(y_by_u, a);
    out.x_by_params = Unit(vec4f(), x * powers, vec4f(x * last, n + 2.0 * u.x * u.x, xy), vec4f(n, n * n, 0.0, 0.0));
    out.y_by_params = Unit(vec4f(), y * powers, vec4f(y * last, xy, n + 2.0 * u.y * u.y), vec4f(0.0, 0.0, n, n * n));
    return out;
}

fn change_tilted(k: Unit, dk: Unit, x: Difference, y: Difference) -> vec2f {
    let s = square_of(x, y);
    let high = polynomial_of(vec4f(k.c.xy, 0.0, 0.0), vec4f(dk.c.xy, 0.0, 0.0), s);
    let s2 = times(s, s);
    let factor = raised(plus(polynomial_of(k.b, dk.b, s), times(times(s2, s2), high)), 1.0);
    let u = times(factor, x);
    let v = times(factor, y);
    let n = square_of(u, v);
    let prism_x = polynomial_of(vec4f(k.d.xy, 0.0, 0.0), vec4f(dk.d.xy, 0.0, 0.0), n);
    let prism_y = polynomial_of(vec4f(k.d.zw, 0.0, 0.0), vec4f(dk.d.zw, 0.0, 0.0), n);
    return vec2f(u.change, v.change)
        + tangential_change(k.c.wz, dk.c.wz, u, v, n)
        + vec2f(prism_x.change, prism_y.change);
}
