// The models whose distortion is a polynomial, or a fraction of two, in the squared radius, with tangential and prism
// terms: pinhole and radial models, OPENCV and FULL_OPENCV on the plane; their fisheye kin and THIN_PRISM_FISHEYE in
// angles (source: algorithms.md §3.5).

#import "common/camera/difference.wgsl"
#import "common/camera/distortion.wgsl"

// (1 + N)/(1 + D)·u + tangential + prism with N and D polynomials without constant term.
struct Lens {
    numerator: vec4f,
    denominator: vec4f,
    // p1, p2 and sx1, sy1.
    sides: vec4f,
}

// The coefficients' places among a camera's parameters.
fn lens_of(model: u32, k: Unit) -> Lens {
    switch model {
        case OPENCV_FISHEYE: {
            return Lens(k.b, vec4f(), vec4f());
        }
        case FULL_OPENCV: {
            return Lens(vec4f(k.b.xy, k.c.x, 0.0), vec4f(k.c.yzw, 0.0), vec4f(k.b.zw, 0.0, 0.0));
        }
        case THIN_PRISM_FISHEYE: {
            return Lens(vec4f(k.b.xy, k.c.xy), vec4f(), vec4f(k.b.zw, k.c.zw));
        }
        default: {
            return Lens(vec4f(k.b.xy, 0.0, 0.0), vec4f(), vec4f(k.b.zw, 0.0, 0.0));
        }
    }
}

// And back: derivatives by the coefficients as derivatives by the parameters.
fn params_of(model: u32, by: Lens) -> Unit {
    switch model {
        case OPENCV_FISHEYE: {
            return Unit(vec4f(), by.numerator, vec4f(), vec4f());
        }
        case FULL_OPENCV: {
            return Unit(vec4f(), vec4f(by.numerator.xy, by.sides.xy), vec4f(by.numerator.z, by.denominator.xyz), vec4f());
        }
        case THIN_PRISM_FISHEYE: {
            return Unit(vec4f(), vec4f(by.numerator.xy, by.sides.xy), vec4f(by.numerator.zw, by.sides.zw), vec4f());
        }
        default: {
            return Unit(vec4f(), vec4f(by.numerator.xy, by.sides.xy), vec4f(), vec4f());
        }
    }
}

// n (k₁ + k₂ n + k₃ n² + k₄ n³) and its slope.
fn polynomial(k: vec4f, n: f32) -> vec2f {
    return vec2f(n * (k.x + n * (k.y + n * (k.z + n * k.w))), k.x + n * (2.0 * k.y + n * (3.0 * k.z + n * 4.0 * k.w)));
}

// 2p₁xy + p₂(n + 2x²), 2p₂xy + p₁(n + 2y²).
fn tangential(p: vec2f, u: vec2f, n: f32) -> vec2f {
    let xy = 2.0 * u.x * u.y;
    return vec2f(p.x * xy + p.y * (n + 2.0 * u.x * u.x), p.y * xy + p.x * (n + 2.0 * u.y * u.y));
}

// Rows of its derivative by the point: xx, xy, yx, yy.
fn tangential_slope(p: vec2f, u: vec2f) -> vec4f {
    let mixed = 2.0 * (p.x * u.x + p.y * u.y);
    return vec4f(2.0 * p.x * u.y + 6.0 * p.y * u.x, mixed, mixed, 2.0 * p.y * u.x + 6.0 * p.x * u.y);
}

// A fraction ends at its pole.
fn is_before_pole(k: Lens, u: vec2f) -> bool {
    return 1.0 + polynomial(k.denominator, dot(u, u)).x > 0.0;
}

fn distort_polynomial(k: Lens, u: vec2f) -> vec2f {
    let n = dot(u, u);
    let factor = (1.0 + polynomial(k.numerator, n).x) / (1.0 + polynomial(k.denominator, n).x);
    return factor * u + tangential(k.sides.xy, u, n) + n * k.sides.zw;
}

fn differentiate_polynomial(model: u32, k: Lens, u: vec2f) -> Distorted {
    let n = dot(u, u);
    let numerator = polynomial(k.numerator, n);
    let denominator = polynomial(k.denominator, n);
    let inverse = 1.0 / (1.0 + denominator.x);
    let factor = (1.0 + numerator.x) * inverse;
    let slope = 2.0 * (numerator.y - factor * denominator.y) * inverse;
    let mixed = slope * u.x * u.y;
    let sides = tangential_slope(k.sides.xy, u);
    let xy = 2.0 * u.x * u.y;
    let powers = inverse * n * vec4f(1.0, n, n * n, n * n * n);
    var out: Distorted;
    out.point = factor * u + tangential(k.sides.xy, u, n) + n * k.sides.zw;
    out.x_by_point = vec2f(factor + slope * u.x * u.x, mixed) + sides.xy + 2.0 * k.sides.z * u;
    out.y_by_point = vec2f(mixed, factor + slope * u.y * u.y) + sides.zw + 2.0 * k.sides.w * u;
    out.x_by_params =
        params_of(model, Lens(u.x * powers, -factor * u.x * powers, vec4f(xy, n + 2.0 * u.x * u.x, n, 0.0)));
    out.y_by_params =
        params_of(model, Lens(u.y * powers, -factor * u.y * powers, vec4f(n + 2.0 * u.y * u.y, xy, 0.0, n)));
    return out;
}

// Of the tangential terms.
fn tangential_change(p: vec2f, dp: vec2f, x: Difference, y: Difference, n: Difference) -> vec2f {
    let p1 = changed(p.x, dp.x);
    let p2 = changed(p.y, dp.y);
    let xy = scaled(2.0, times(x, y));
    let xx = plus(n, scaled(2.0, times(x, x)));
    let yy = plus(n, scaled(2.0, times(y, y)));
    return vec2f(
        times(p1, xy).change + times(p2, xx).change,
        times(p2, xy).change + times(p1, yy).change,
    );
}

fn change_polynomial(k: Lens, dk: Lens, x: Difference, y: Difference) -> vec2f {
    let n = square_of(x, y);
    let factor = over(
        raised(polynomial_of(k.numerator, dk.numerator, n), 1.0),
        raised(polynomial_of(k.denominator, dk.denominator, n), 1.0),
    );
    return vec2f(times(factor, x).change, times(factor, y).change)
        + tangential_change(k.sides.xy, dk.sides.xy, x, y, n)
        + vec2f(
            times(changed(k.sides.z, dk.sides.z), n).change,
            times(changed(k.sides.w, dk.sides.w), n).change,
        );
}
