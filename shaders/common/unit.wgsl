// One number for each unknown of a unit, in whole vec4f: of a camera its parameters, of an image rotation and centre in
// the first six. What is beyond a unit's unknowns is 0.

#if wide
const UNIT_VEC4 = 4u;
#else
const UNIT_VEC4 = 2u;
#endif
// Parameters of a camera.
const PARAMS = 4u * UNIT_VEC4;

struct Unit {
    a: vec4f,
    b: vec4f,
#if wide
    c: vec4f,
    d: vec4f,
#endif
}

#if wide
// A unit of eight numbers at most.
fn short_unit(a: vec4f, b: vec4f) -> Unit {
    return Unit(a, b, vec4f(), vec4f());
}

fn add_units(x: Unit, y: Unit) -> Unit {
    return Unit(x.a + y.a, x.b + y.b, x.c + y.c, x.d + y.d);
}

// Number by number.
fn multiply_units(x: Unit, y: Unit) -> Unit {
    return Unit(x.a * y.a, x.b * y.b, x.c * y.c, x.d * y.d);
}

fn scale_unit(s: f32, x: Unit) -> Unit {
    return Unit(s * x.a, s * x.b, s * x.c, s * x.d);
}

fn dot_units(x: Unit, y: Unit) -> f32 {
    return dot(x.a, y.a) + dot(x.b, y.b) + (dot(x.c, y.c) + dot(x.d, y.d));
}

// With a number before it.
fn add_dot_units(start: f32, x: Unit, y: Unit) -> f32 {
    return start + dot(x.a, y.a) + dot(x.b, y.b) + (dot(x.c, y.c) + dot(x.d, y.d));
}

fn largest_of(x: Unit) -> f32 {
    let m = max(max(abs(x.a), abs(x.b)), max(abs(x.c), abs(x.d)));
    return max(max(m.x, m.y), max(m.z, m.w));
}
#else
// A unit of eight numbers at most.
fn short_unit(a: vec4f, b: vec4f) -> Unit {
    return Unit(a, b);
}

fn add_units(x: Unit, y: Unit) -> Unit {
    return Unit(x.a + y.a, x.b + y.b);
}

// Number by number.
fn multiply_units(x: Unit, y: Unit) -> Unit {
    return Unit(x.a * y.a, x.b * y.b);
}

fn scale_unit(s: f32, x: Unit) -> Unit {
    return Unit(s * x.a, s * x.b);
}

fn dot_units(x: Unit, y: Unit) -> f32 {
    return dot(x.a, y.a) + dot(x.b, y.b);
}

// With a number before it.
fn add_dot_units(start: f32, x: Unit, y: Unit) -> f32 {
    return start + dot(x.a, y.a) + dot(x.b, y.b);
}

fn largest_of(x: Unit) -> f32 {
    let m = max(abs(x.a), abs(x.b));
    return max(max(m.x, m.y), max(m.z, m.w));
}
#endif

fn minus_units(x: Unit, y: Unit) -> Unit {
    return add_units(x, scale_unit(-1.0, y));
}

fn no_unit() -> Unit {
    return short_unit(vec4f(), vec4f());
}
