// Arctangent and tangent to two units in the last place. WGSL allows its own 4096 for atan and atan2, 1e-3 of a radian
// in sine and cosine: several pixels of a wide image, and other pixels on every device. Coefficients: interpolation of
// (f(x)/x − 1)/x² at Chebyshev nodes in x², relative error below 6e-8.

const PI = 3.1415927;
const HALF_PI = 1.5707964;
// π/2 − HALF_PI and π − PI: what rounding took from the constants.
const HALF_PI_REST = -4.371139e-8;
const PI_REST = -8.742278e-8;
// Keeps squares of radii away from zero, as in crates/geometry/src/camera/fisheye.rs.
const TINY = 1e-30;

// For 0 ≤ t ≤ 1.
fn arctangent_of_share(t: f32) -> f32 {
    let z = t * t;
    var p = fma(-0.0023869972, z, 0.01350777130573988);
    p = fma(p, z, -0.035871539264917374);
    p = fma(p, z, 0.0625016912817955);
    p = fma(p, z, -0.08656880259513855);
    p = fma(p, z, 0.11033764481544495);
    p = fma(p, z, -0.1427856832742691);
    p = fma(p, z, 0.19999739527702332);
    p = fma(p, z, -0.3333333134651184);
    return fma(t * z, p, t);
}

fn arctangent2(y: f32, x: f32) -> f32 {
    let a = abs(y);
    let b = abs(x);
    // The least normal number: 0/0 is 0.
    var angle = arctangent_of_share(min(a, b) / max(max(a, b), 1.1754944e-38));
    if a > b {
        angle = HALF_PI - (angle - HALF_PI_REST);
    }
    if x < 0.0 {
        angle = PI - (angle - PI_REST);
    }
    return select(angle, -angle, y < 0.0);
}

fn arctangent(t: f32) -> f32 {
    return arctangent2(t, 1.0);
}

fn tangent(angle: f32) -> f32 {
    let turns = round(angle / PI);
    let reduced = (angle - turns * PI) - turns * PI_REST;
    let a = abs(reduced);
    let steep = a > 0.5 * HALF_PI;
    let t = select(a, (HALF_PI - a) + HALF_PI_REST, steep);
    let z = t * t;
    var p = fma(0.008254695683717728, z, 0.005091927479952574);
    p = fma(p, z, 0.02316485531628132);
    p = fma(p, z, 0.053773827850818634);
    p = fma(p, z, 0.13334380090236664);
    p = fma(p, z, 0.33333325386047363);
    let value = fma(t * z, p, t);
    let positive = select(value, 1.0 / value, steep);
    return select(positive, -positive, reduced < 0.0);
}
