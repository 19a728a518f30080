// The 3 × 3 block of a point by Givens rotations: backward stable in f32, where a Cholesky factor of JᵀJ is not
// (source: solver.md §1.3 b).

#import "common/triangle.wgsl"

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

// (R̃ᵀR̃)⁻¹ g.
fn solve_normal(block: Block, g: vec3f) -> vec3f {
    return solve_triangle(block.damped_top.xyz, block.damped_bottom.xyz, g);
}
