// EQUIRECTANGULAR: longitude and latitude, every direction has a pixel (source: algorithms.md §3.5). Parameters w, h.

#import "common/camera/difference.wgsl"
#import "common/unit.wgsl"

const INVERSE_PI = 0.31830987;

// The larger part of the pixel goes first, so that large numbers cancel before small ones are lost.
fn sphere_residual(k: Unit, q: vec3f, pixel: vec2f) -> vec2f {
    let horizontal = sqrt(q.x * q.x + q.z * q.z + TINY);
    let turns = INVERSE_PI * vec2f(0.5 * arctangent2(q.x, q.z), arctangent2(q.y, horizontal));
    return k.a.xy * turns + (0.5 * k.a.xy - pixel);
}

// Rows by the point, before the factors w and h; and both shares of the image.
struct Sphere {
    x_by_q: vec3f,
    y_by_q: vec3f,
    share: vec2f,
}

fn differentiate_sphere(q: vec3f) -> Sphere {
    let flat = q.x * q.x + q.z * q.z + TINY;
    let horizontal = sqrt(flat);
    let inverse = 1.0 / (flat + q.y * q.y);
    let lean = -INVERSE_PI * inverse * q.y / horizontal;
    return Sphere(
        (0.5 * INVERSE_PI / flat) * vec3f(q.z, 0.0, -q.x),
        vec3f(lean * q.x, INVERSE_PI * inverse * horizontal, lean * q.z),
        INVERSE_PI * vec2f(0.5 * arctangent2(q.x, q.z), arctangent2(q.y, horizontal)) + 0.5,
    );
}

// The short way round where the image ends.
fn sphere_change(k: Unit, dk: Unit, q: vec3f, dq: vec3f) -> vec2f {
    let x = changed(q.x, dq.x);
    let y = changed(q.y, dq.y);
    let z = changed(q.z, dq.z);
    let horizontal = root_of(raised(square_of(x, z), TINY));
    let longitude = raised(scaled(0.5 * INVERSE_PI, angle_of(x, z)), 0.5);
    let latitude = raised(scaled(INVERSE_PI, angle_of(y, horizontal)), 0.5);
    return vec2f(
        times(longitude, changed(k.a.x, dk.a.x)).change,
        times(latitude, changed(k.a.y, dk.a.y)).change,
    );
}
