// FOV: scales by atan(2r tan(ω/2))/(rω), of Devernay and Faugeras (source: algorithms.md §3.5). Even in ω, evaluated at
// √(ω² + tiny) as in crates/geometry/src/camera/fov.rs.

#import "common/camera/difference.wgsl"
#import "common/camera/distortion.wgsl"

fn distort_fov(k: Unit, u: vec2f) -> vec2f {
    let omega = sqrt(k.b.x * k.b.x + TINY);
    let r = sqrt(dot(u, u) + TINY);
    return (arctangent(2.0 * r * tangent(0.5 * omega)) / r / omega) * u;
}

fn differentiate_fov(k: Unit, u: vec2f) -> Distorted {
    let omega = sqrt(k.b.x * k.b.x + TINY);
    let n = dot(u, u) + TINY;
    let r = sqrt(n);
    let t = 2.0 * tangent(0.5 * omega);
    let flat = 1.0 / (1.0 + n * t * t);
    let ratio = arctangent(r * t) / r;
    let factor = ratio / omega;
    let slope = (t * flat - ratio) / omega / n;
    let mixed = slope * u.x * u.y;
    // By ω: (dt/dω · r/(1 + r²t²) − atan(rt)/ω)/(rω).
    let by_omega = (k.b.x / omega) * (((1.0 + 0.25 * t * t) * flat - factor) / omega);
    var out: Distorted;
    out.point = factor * u;
    out.x_by_point = vec2f(factor + slope * u.x * u.x, mixed);
    out.y_by_point = vec2f(mixed, factor + slope * u.y * u.y);
    out.x_by_params = short_unit(vec4f(), vec4f(by_omega * u.x, 0.0, 0.0, 0.0));
    out.y_by_params = short_unit(vec4f(), vec4f(by_omega * u.y, 0.0, 0.0, 0.0));
    return out;
}

fn change_fov(k: Unit, dk: Unit, x: Difference, y: Difference) -> vec2f {
    let parameter = changed(k.b.x, dk.b.x);
    let omega = root_of(raised(times(parameter, parameter), TINY));
    let r = root_of(raised(square_of(x, y), TINY));
    let t = scaled(2.0, tangent_of(scaled(0.5, omega)));
    let factor = over(over(angle_of(times(r, t), changed(1.0, 0.0)), r), omega);
    return vec2f(times(factor, x).change, times(factor, y).change);
}
