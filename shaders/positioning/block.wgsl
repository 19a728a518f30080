// The 3 × 3 block of a point.

#import "common/triangle.wgsl"

// A diagonal entry below this part of the trace is damped as if it were this large, as on the CPU.
const DIAGONAL_FLOOR = 1e-6;

struct PointBlock {
    // Upper triangle R by rows (r00 r01 r02), (r11 r12 r22), with RᵀR the sum of the blocks. The fourth numbers of the
    // first three rows are the gradient.
    top: vec4f,
    bottom: vec4f,
    // R damped by λ, with the reciprocals of its diagonal in place of the diagonal; zero where nothing holds the point.
    damped_top: vec4f,
    damped_bottom: vec4f,
}

fn block_gradient(block: PointBlock) -> vec3f {
    return vec3f(block.top.w, block.bottom.w, block.damped_top.w);
}

// What λ multiplies.
fn damping_diagonal(block: PointBlock) -> vec3f {
    return floored(column_norms(Triangle(block.top.xyz, block.bottom.xyz)));
}

fn floored(diagonal: vec3f) -> vec3f {
    return max(diagonal, vec3f(DIAGONAL_FLOOR * (diagonal.x + diagonal.y + diagonal.z)));
}

// (R̃ᵀR̃)⁻¹ g.
fn solve_block(block: PointBlock, g: vec3f) -> vec3f {
    return solve_triangle(block.damped_top.xyz, block.damped_bottom.xyz, g);
}

// Folds scale (I − direction directionᵀ) for a unit direction: two rows across it (Duff et al., JCGT 2017).
fn fold_across(r: Triangle, scale: f32, n: vec3f) -> Triangle {
    let sign = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let first = fold_row(r, scale * vec3f(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x));
    return fold_row(first, scale * vec3f(b, sign + n.y * n.y * a, -n.y));
}

fn fold_identity(r: Triangle, scale: vec3f) -> Triangle {
    var out = fold_row(r, vec3f(scale.x, 0.0, 0.0));
    out = fold_row(out, vec3f(0.0, scale.y, 0.0));
    return fold_row(out, vec3f(0.0, 0.0, scale.z));
}

// The reciprocals of the diagonal in its place; all zero where the triangle has no inverse.
fn inverted_diagonal(r: Triangle) -> Triangle {
    if min(r.top.x, min(r.bottom.x, r.bottom.z)) > 0.0 {
        return Triangle(vec3f(1.0 / r.top.x, r.top.yz), vec3f(1.0 / r.bottom.x, r.bottom.y, 1.0 / r.bottom.z));
    }
    return Triangle(vec3f(), vec3f());
}
