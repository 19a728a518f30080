// The two halves of the reduced operator in three forms: Jacobians recomputed, stored in f32, stored in f16. Nine
// unknowns a camera (rotation, centre, f, k1, k2), as in BAL problems; the shapes are those of the product's kernels.

struct Params {
    points: u32,
    segments: u32,
}

struct Camera {
    // Rows of the rotation with the centre as fourth column.
    r0: vec4f,
    r1: vec4f,
    r2: vec4f,
    // f, k1, k2.
    k: vec4f,
    // The direction: rotation, centre, intrinsics.
    rotation: vec4f,
    center: vec4f,
    intrinsics: vec4f,
    padding: vec4f,
}

// One sector of 32 bytes: position, y.
struct Point {
    x: vec4f,
    y: vec4f,
}

struct Seen {
    // Image by points, point by images.
    other: u32,
    weight: f32,
}

struct Row {
    px: vec3f,
    py: vec3f,
    rotation_x: vec3f,
    rotation_y: vec3f,
    intrinsics_x: vec3f,
    intrinsics_y: vec3f,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> cameras: array<Camera>;
@group(0) @binding(2) var<storage, read_write> points: array<Point>;
@group(0) @binding(3) var<storage, read> tracks: array<u32>;
@group(0) @binding(4) var<storage, read> by_point: array<Seen>;
@group(0) @binding(5) var<storage, read> segments: array<vec4u>;
@group(0) @binding(6) var<storage, read> by_image: array<Seen>;
// Six vec4 or twelve words an observation.
@group(0) @binding(7) var<storage, read_write> stored: array<vec4u>;
// Rotation, centre, intrinsics and ‖v‖² by segment.
@group(0) @binding(8) var<storage, read_write> sums: array<array<vec4f, 3>>;

fn row_of(x: vec3f, c: Camera, weight: f32) -> Row {
    let ray = x - vec3f(c.r0.w, c.r1.w, c.r2.w);
    let q = vec3f(dot(c.r0.xyz, ray), dot(c.r1.xyz, ray), dot(c.r2.xyz, ray));
    let u = q.xy / q.z;
    let n = dot(u, u);
    let d = 1.0 + n * (c.k.y + c.k.z * n);
    let slope = 2.0 * (c.k.y + 2.0 * c.k.z * n);
    let scale = weight * c.k.x / q.z;
    let bx = scale * vec2f(d + slope * u.x * u.x, slope * u.x * u.y);
    let by = scale * vec2f(slope * u.x * u.y, d + slope * u.y * u.y);
    var row: Row;
    row.px = bx.x * c.r0.xyz + bx.y * c.r1.xyz - dot(bx, u) * c.r2.xyz;
    row.py = by.x * c.r0.xyz + by.y * c.r1.xyz - dot(by, u) * c.r2.xyz;
    row.rotation_x = cross(ray, row.px);
    row.rotation_y = cross(ray, row.py);
    row.intrinsics_x = weight * u.x * vec3f(d, c.k.x * n, c.k.x * n * n);
    row.intrinsics_y = weight * u.y * vec3f(d, c.k.x * n, c.k.x * n * n);
    return row;
}

fn camera_product(row: Row, c: Camera) -> vec2f {
    return vec2f(
        dot(row.rotation_x, c.rotation.xyz) - dot(row.px, c.center.xyz) + dot(row.intrinsics_x, c.intrinsics.xyz),
        dot(row.rotation_y, c.rotation.xyz) - dot(row.py, c.center.xyz) + dot(row.intrinsics_y, c.intrinsics.xyz),
    );
}

fn store32(o: u32, row: Row) {
    stored[6u * o] = bitcast<vec4u>(vec4f(row.px, row.py.x));
    stored[6u * o + 1u] = bitcast<vec4u>(vec4f(row.py.yz, row.rotation_x.xy));
    stored[6u * o + 2u] = bitcast<vec4u>(vec4f(row.rotation_x.z, row.rotation_y));
    stored[6u * o + 3u] = bitcast<vec4u>(vec4f(row.intrinsics_x, row.intrinsics_y.x));
    stored[6u * o + 4u] = bitcast<vec4u>(vec4f(row.intrinsics_y.yz, 0.0, 0.0));
}

fn load32(o: u32) -> Row {
    let a = bitcast<vec4f>(stored[6u * o]);
    let b = bitcast<vec4f>(stored[6u * o + 1u]);
    let c = bitcast<vec4f>(stored[6u * o + 2u]);
    let d = bitcast<vec4f>(stored[6u * o + 3u]);
    let e = bitcast<vec4f>(stored[6u * o + 4u]);
    return Row(a.xyz, vec3f(a.w, b.xy), vec3f(b.zw, c.x), c.yzw, d.xyz, vec3f(d.w, e.xy));
}

fn pack(x: f32, y: f32) -> u32 {
    return pack2x16float(vec2f(x, y));
}

fn store16(o: u32, r: Row) {
    stored[3u * o] = vec4u(pack(r.px.x, r.px.y), pack(r.px.z, r.py.x), pack(r.py.y, r.py.z), pack(r.rotation_x.x, r.rotation_x.y));
    stored[3u * o + 1u] = vec4u(
        pack(r.rotation_x.z, r.rotation_y.x), pack(r.rotation_y.y, r.rotation_y.z),
        pack(r.intrinsics_x.x, r.intrinsics_x.y), pack(r.intrinsics_x.z, r.intrinsics_y.x),
    );
    stored[3u * o + 2u] = vec4u(pack(r.intrinsics_y.y, r.intrinsics_y.z), 0u, 0u, 0u);
}

fn load16(o: u32) -> Row {
    let a = stored[3u * o];
    let b = stored[3u * o + 1u];
    let a0 = vec4f(unpack2x16float(a.x), unpack2x16float(a.y));
    let a1 = vec4f(unpack2x16float(a.z), unpack2x16float(a.w));
    let b0 = vec4f(unpack2x16float(b.x), unpack2x16float(b.y));
    let b1 = vec4f(unpack2x16float(b.z), unpack2x16float(b.w));
    let last = unpack2x16float(stored[3u * o + 2u].x);
    return Row(a0.xyz, vec3f(a0.w, a1.xy), vec3f(a1.zw, b0.x), b0.yzw, b1.xyz, vec3f(b1.w, last));
}

fn point_of(g: vec3u, groups: vec3u, lane: u32) -> u32 {
    return (g.y * groups.x + g.x) * 64u + lane;
}

FORMS

// Fixed tree over 64 lanes.
var<workgroup> tree: array<array<vec4f, 3>, 64>;

fn reduce(lane: u32, value: array<vec4f, 3>) -> array<vec4f, 3> {
    tree[lane] = value;
    for (var stride = 32u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            for (var k = 0u; k < 3u; k += 1u) {
                tree[lane][k] += tree[lane + stride][k];
            }
        }
    }
    workgroupBarrier();
    return tree[0];
}
