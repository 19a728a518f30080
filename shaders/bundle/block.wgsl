// The 3 × 3 block of a point by Givens rotations: backward stable in f32, where a Cholesky factor of JᵀJ is not
// (source: solver.md §1.3 b).

struct Block {
    // Upper triangle R by rows (r00 r01 r02), (r11 r12 r22), with RᵀR = J_pᵀ J_p. norms.w is 1 where the point moves.
    top: vec4f,
    bottom: vec4f,
    // J_pᵀ r.
    gradient: vec4f,
    // Squared column norms of J_p.
    norms: vec4f,
    // R damped by λ, with the reciprocals of its diagonal in place of the diagonal; zero where the point is frozen.
    damped_top: vec4f,
    damped_bottom: vec4f,
}

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

// (R̃ᵀR̃)⁻¹ g.
fn solve_normal(block: Block, g: vec3f) -> vec3f {
    let top = block.damped_top.xyz;
    let bottom = block.damped_bottom.xyz;
    let y = solve_row(top, bottom, g);
    let c = y.z * bottom.z;
    let b = (y.y - bottom.y * c) * bottom.x;
    return vec3f((y.x - top.y * b - top.z * c) * top.x, b, c);
}
