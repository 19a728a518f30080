// What every lens model gives: a distorted point with its derivatives, on the plane z = 1 or in angles from the axis.

#import "common/unit.wgsl"

struct Distorted {
    point: vec2f,
    // Rows of the derivative by the undistorted point.
    x_by_point: vec2f,
    y_by_point: vec2f,
    // By the distortion parameters, in b, c and d; a is left 0.
    x_by_params: Unit,
    y_by_params: Unit,
}

// Both rows times a matrix on the right, given by its rows.
fn compose_rows(d: Distorted, top: vec2f, bottom: vec2f) -> Distorted {
    var out = d;
    out.x_by_point = d.x_by_point.x * top + d.x_by_point.y * bottom;
    out.y_by_point = d.y_by_point.x * top + d.y_by_point.y * bottom;
    return out;
}
