// Schur–Jacobi blocks A (I − A (R̃ᵀR̃)⁻¹ A) A, the right-hand side and the undamped diagonal, by segment of a camera:
// the cancellation happens inside each observation. Three vec4f a segment: block (00 01 02 11), block (12 22) with
// right-hand side (0 1), right-hand side (2) with diagonal.

#import "common/dispatch.wgsl"
#import "positioning/model.wgsl"
#import "positioning/block.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> settings: Settings;
@group(0) @binding(2) var<storage, read> centers: array<vec4f>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> segments: array<Segment>;
@group(0) @binding(5) var<storage, read> by_camera: array<ByCamera>;
@group(0) @binding(6) var<storage, read> rays: array<vec4f>;
@group(0) @binding(7) var<storage, read> blocks: array<PointBlock>;
@group(0) @binding(8) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> block_sums: array<vec4f>;

struct Twelve {
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

var<workgroup> tree: array<Twelve, 64>;

fn add_twelve(x: Twelve, y: Twelve) -> Twelve {
    return Twelve(x.a + y.a, x.b + y.b, x.c + y.c);
}

fn observation_sums(found: Linear, point: Point, block: PointBlock) -> Twelve {
    let top = block.damped_top.xyz;
    let bottom = block.damped_bottom.xyz;
    let row = found.row;
    let a0 = apply_root(row, vec3f(1.0, 0.0, 0.0));
    let a1 = apply_root(row, vec3f(0.0, 1.0, 0.0));
    let a2 = apply_root(row, vec3f(0.0, 0.0, 1.0));
    let z0 = solve_row(top, bottom, a0);
    let z1 = solve_row(top, bottom, a1);
    let z2 = solve_row(top, bottom, a2);
    // I − A (R̃ᵀR̃)⁻¹ A, symmetric.
    let n0 = vec3f(1.0 - dot(z0, z0), -dot(z0, z1), -dot(z0, z2));
    let n1 = vec3f(n0.y, 1.0 - dot(z1, z1), -dot(z1, z2));
    let n2 = vec3f(n0.z, n1.z, 1.0 - dot(z2, z2));
    let m0 = vec3f(dot(n0, a0), dot(n1, a0), dot(n2, a0));
    let m1 = vec3f(dot(n0, a1), dot(n1, a1), dot(n2, a1));
    let m2 = vec3f(dot(n0, a2), dot(n1, a2), dot(n2, a2));
    let right = found.gradient - apply_block(row, point.s);
    return Twelve(
        vec4f(dot(a0, m0), dot(a0, m1), dot(a0, m2), dot(a1, m1)),
        vec4f(dot(a1, m2), dot(a2, m2), right.xy),
        vec4f(right.z, dot(a0, a0), dot(a1, a1), dot(a2, a2)),
    );
}

@compute @workgroup_size(64)
fn position_precondition(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let g = min(linear_group(group, num_groups), params.segments - 1u);
    let segment = segments[g];
    let center = centers[segment.camera];
    let least = vectors[3].x;
    var sum = Twelve(vec4f(), vec4f(), vec4f());
    for (var o = segment.start + lane; o < segment.end; o += 64u) {
        let p = by_camera[o].point;
        let point = points[p];
        let found = linearize(settings, rays[by_camera[o].index], center.w, point.x - center.xyz, least);
        sum = add_twelve(sum, observation_sums(found, point, blocks[p]));
    }
    tree[lane] = sum;
    for (var stride = 32u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            let x = tree[lane];
            let y = tree[lane + stride];
            tree[lane] = add_twelve(x, y);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        let at = 3u * (params.first_segment + g);
        block_sums[at] = tree[0].a;
        block_sums[at + 1u] = tree[0].b;
        block_sums[at + 2u] = tree[0].c;
    }
}
