// EUCM: divides by α√(βr² + 1) + 1 − α, the enhanced unified camera of Khomutenko, Garcia and Martinet
// (source: algorithms.md §3.5). √s − 1 = βr²/(1 + √s) keeps the digits near the axis.

#import "common/camera/difference.wgsl"
#import "common/camera/distortion.wgsl"

// The divisor, or 0 where there is no root.
fn eucm_divisor(k: Unit, u: vec2f) -> f32 {
    let bent = k.b.y * dot(u, u);
    if bent + 1.0 < 0.0 {
        return 0.0;
    }
    return 1.0 + k.b.x * bent / (1.0 + sqrt(1.0 + bent));
}

fn distort_eucm(k: Unit, u: vec2f) -> vec2f {
    return u / eucm_divisor(k, u);
}

fn differentiate_eucm(k: Unit, u: vec2f) -> Distorted {
    let n = dot(u, u);
    let bent = k.b.y * n;
    let root = sqrt(1.0 + bent);
    let factor = 1.0 / eucm_divisor(k, u);
    let falling = -factor * factor;
    let slope = falling * k.b.x * k.b.y / root;
    let mixed = slope * u.x * u.y;
    let by_params = falling * vec4f(bent / (1.0 + root), 0.5 * k.b.x * n / root, 0.0, 0.0);
    var out: Distorted;
    out.point = factor * u;
    out.x_by_point = vec2f(factor + slope * u.x * u.x, mixed);
    out.y_by_point = vec2f(mixed, factor + slope * u.y * u.y);
    out.x_by_params = short_unit(vec4f(), u.x * by_params);
    out.y_by_params = short_unit(vec4f(), u.y * by_params);
    return out;
}

fn change_eucm(k: Unit, dk: Unit, x: Difference, y: Difference) -> vec2f {
    let bent = times(changed(k.b.y, dk.b.y), square_of(x, y));
    let above = over(bent, raised(root_of(raised(bent, 1.0)), 1.0));
    let divisor = raised(times(changed(k.b.x, dk.b.x), above), 1.0);
    return vec2f(over(x, divisor).change, over(y, divisor).change);
}
