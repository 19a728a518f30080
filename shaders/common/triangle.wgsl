// Upper triangles by Givens rotations, row by row: backward stable in f32 (source: solver.md §1.3 b).

struct Triangle {
    // r00 r01 r02
    top: vec3f,
    // r11 r12 r22
    bottom: vec3f,
}

// Folds a row of J_p into R.
fn fold_row(r: Triangle, row: vec3f) -> Triangle {
    var out = r;
    var v = row;
    if v.x != 0.0 {
        let norm = sqrt(out.top.x * out.top.x + v.x * v.x);
        let c = out.top.x / norm;
        let s = v.x / norm;
        let line = c * out.top.yz + s * v.yz;
        v = vec3f(0.0, c * v.yz - s * out.top.yz);
        out.top = vec3f(norm, line);
    }
    if v.y != 0.0 {
        let norm = sqrt(out.bottom.x * out.bottom.x + v.y * v.y);
        let c = out.bottom.x / norm;
        let s = v.y / norm;
        let line = c * out.bottom.y + s * v.z;
        v.z = c * v.z - s * out.bottom.y;
        out.bottom = vec3f(norm, line, out.bottom.z);
    }
    out.bottom.z = sqrt(out.bottom.z * out.bottom.z + v.z * v.z);
    return out;
}

// v R̃⁻¹.
fn solve_row(top: vec3f, bottom: vec3f, v: vec3f) -> vec3f {
    let a = v.x * top.x;
    let b = (v.y - a * top.y) * bottom.x;
    return vec3f(a, b, (v.z - a * top.z - b * bottom.y) * bottom.z);
}

// (R̃ᵀR̃)⁻¹ g for a triangle with the reciprocals of its diagonal in place of the diagonal.
fn solve_triangle(top: vec3f, bottom: vec3f, g: vec3f) -> vec3f {
    let y = solve_row(top, bottom, g);
    let c = y.z * bottom.z;
    let b = (y.y - bottom.y * c) * bottom.x;
    return vec3f((y.x - top.y * b - top.z * c) * top.x, b, c);
}

// Squared norms of the columns that were folded.
fn column_norms(r: Triangle) -> vec3f {
    return vec3f(
        r.top.x * r.top.x,
        r.top.y * r.top.y + r.bottom.x * r.bottom.x,
        r.top.z * r.top.z + r.bottom.y * r.bottom.y + r.bottom.z * r.bottom.z,
    );
}
