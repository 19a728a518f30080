// SIMPLE_DIVISION and DIVISION: scales by 2/(1 + √(1 − 4kr²)), of Fitzgibbon (source: algorithms.md §3.5).

#import "common/camera/difference.wgsl"
#import "common/camera/distortion.wgsl"

// Beyond it a ray meets no pixel.
fn division_square(k: Unit, u: vec2f) -> f32 {
    return 1.0 - 4.0 * k.b.x * dot(u, u);
}

fn distort_division(k: Unit, u: vec2f) -> vec2f {
    return (2.0 / (1.0 + sqrt(division_square(k, u)))) * u;
}

fn differentiate_division(k: Unit, u: vec2f) -> Distorted {
    let n = dot(u, u);
    let root = sqrt(division_square(k, u));
    let factor = 2.0 / (1.0 + root);
    let by_square = factor * factor / root;
    let slope = 2.0 * by_square * k.b.x;
    let mixed = slope * u.x * u.y;
    var out: Distorted;
    out.point = factor * u;
    out.x_by_point = vec2f(factor + slope * u.x * u.x, mixed);
    out.y_by_point = vec2f(mixed, factor + slope * u.y * u.y);
    out.x_by_params = short_unit(vec4f(), vec4f(by_square * n * u.x, 0.0, 0.0, 0.0));
    out.y_by_params = short_unit(vec4f(), vec4f(by_square * n * u.y, 0.0, 0.0, 0.0));
    return out;
}

fn change_division(k: Unit, dk: Unit, x: Difference, y: Difference) -> vec2f {
    let square = raised(scaled(-4.0, times(changed(k.b.x, dk.b.x), square_of(x, y))), 1.0);
    let factor = over(changed(2.0, 0.0), raised(root_of(square), 1.0));
    return vec2f(times(factor, x).change, times(factor, y).change);
}
