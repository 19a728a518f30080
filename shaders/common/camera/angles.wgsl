// The map that all fisheye models start with: from the plane z = 1 to angles from the axis, (x, y)·θ/r with θ = atan r
// (source: algorithms.md §3.5). The ratio needs no series near the axis: its error is relative to 1.

#import "common/camera/difference.wgsl"
#import "common/camera/distortion.wgsl"

fn angles(u: vec2f) -> vec2f {
    let r = sqrt(dot(u, u) + TINY);
    return (arctangent(r) / r) * u;
}

// A distortion in angles as one of the plane.
fn from_plane(d: Distorted, u: vec2f) -> Distorted {
    let n = dot(u, u) + TINY;
    let r = sqrt(n);
    let ratio = arctangent(r) / r;
    let slope = (1.0 / (1.0 + n) - ratio) / n;
    let mixed = slope * u.x * u.y;
    return compose_rows(d, vec2f(ratio + slope * u.x * u.x, mixed), vec2f(mixed, ratio + slope * u.y * u.y));
}

// Of the plane, before and after, to angles.
fn ratio_of(x: Difference, y: Difference) -> Difference {
    let r = root_of(raised(square_of(x, y), TINY));
    return over(angle_of(r, changed(1.0, 0.0)), r);
}
