// A number before and after a step, with the change carried on its own so that nothing cancels: every term of it is in
// proportion to the step (source: solver.md §1.3 d; as crates/geometry/src/camera/difference.rs).

#import "common/camera/functions.wgsl"

struct Difference {
    before: f32,
    after: f32,
    change: f32,
}

fn changed(before: f32, change: f32) -> Difference {
    return Difference(before, before + change, change);
}

fn plus(x: Difference, y: Difference) -> Difference {
    return Difference(x.before + y.before, x.after + y.after, x.change + y.change);
}

fn minus(x: Difference, y: Difference) -> Difference {
    return Difference(x.before - y.before, x.after - y.after, x.change - y.change);
}

// With a constant added.
fn raised(x: Difference, constant: f32) -> Difference {
    return Difference(x.before + constant, x.after + constant, x.change);
}

fn scaled(s: f32, x: Difference) -> Difference {
    return Difference(s * x.before, s * x.after, s * x.change);
}

fn times(x: Difference, y: Difference) -> Difference {
    return Difference(x.before * y.before, x.after * y.after, x.change * y.after + x.before * y.change);
}

// Dividing by the larger of both denominators keeps the digits.
fn over(x: Difference, y: Difference) -> Difference {
    let before = x.before / y.before;
    let after = x.after / y.after;
    if abs(y.before) >= abs(y.after) {
        return Difference(before, after, (x.change - after * y.change) / y.before);
    }
    return Difference(before, after, (x.change - before * y.change) / y.after);
}

fn root_of(x: Difference) -> Difference {
    let before = sqrt(x.before);
    let after = sqrt(x.after);
    return Difference(before, after, x.change / max(before + after, TINY));
}

// Of the angle of (x, y): the angle between both directions, by their cross and dot products.
fn angle_of(y: Difference, x: Difference) -> Difference {
    let across = x.before * y.change - y.before * x.change;
    let along = x.before * x.after + y.before * y.after;
    return Difference(arctangent2(y.before, x.before), arctangent2(y.after, x.after), arctangent2(across, along));
}

// tan a' − tan a = tan δ (1 + tan a · tan a').
fn tangent_of(x: Difference) -> Difference {
    let before = tangent(x.before);
    let after = tangent(x.after);
    return Difference(before, after, tangent(x.change) * (1.0 + before * after));
}

// The square of a vector's length.
fn square_of(x: Difference, y: Difference) -> Difference {
    return plus(times(x, x), times(y, y));
}

// x (k₁ + k₂ x + k₃ x² + k₄ x³) from the coefficients before and their change.
fn polynomial_of(k: vec4f, dk: vec4f, x: Difference) -> Difference {
    var sum = times(changed(k.w, dk.w), x);
    sum = times(plus(sum, changed(k.z, dk.z)), x);
    sum = times(plus(sum, changed(k.y, dk.y)), x);
    return times(plus(sum, changed(k.x, dk.x)), x);
}
