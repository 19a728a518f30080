// E = R̃⁻ᵀ Σ J_pᵀ J_c Z of each point and row of blocks that it touches, 3 × 8. With H = J_pᵀJ_p,
// J_c Z = −w J_p [I | e × (X − c)/ρ | (C − c)/ρ] needs Σ wH and Σ wH (C − c)/ρ only (source: scale.md §3.3).

#import "common/dispatch.wgsl"
#import "bundle/row.wgsl"
#import "bundle/block.wgsl"
#import "bundle/modes.wgsl"
#import "bundle/coarse.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> views: array<View>;
@group(0) @binding(2) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> by_point: array<ByPoint>;
@group(0) @binding(5) var<storage, read> blocks: array<Block>;
@group(0) @binding(6) var<storage, read> modes: array<Mode>;
@group(0) @binding(7) var<storage, read> coarse_entries: array<CoarseEntry>;
@group(0) @binding(8) var<storage, read_write> coarse_factors: array<vec4f>;

@compute @workgroup_size(64)
fn coarse_entry(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let e = linear_group(group, num_groups) * 64u + lane;
    if e >= arrayLength(&coarse_entries) || coarse_entries[e].point == NO_ENTRY {
        return;
    }
    let entry = coarse_entries[e];
    let point = points[entry.point];
    let block = blocks[entry.point];
    // J_pᵀ J_c Z by columns.
    var columns: array<vec3f, 8>;
    // Σ wH by columns, and the weights' mean of (X − c)/ρ, which is the same for all.
    var normal = mat3x3f();
    var arm = vec3f();
    for (var o = entry.track_start; o < entry.track_end; o += 1u) {
        let seen = by_point[o];
        let image = seen.image & IMAGE_MASK;
        let view = views[image];
        if seen.weight == 0.0 || block.norms.w != 1.0 {
            continue;
        }
        if entry.kind > 0u {
            if view.camera == entry.camera {
                let row = row_of(point, view, intrinsics[view.camera], params.cell, point_weights(seen));
                var x = array<vec4f, 2>(row.x_params.a, row.x_params.b);
                var y = array<vec4f, 2>(row.y_params.a, row.y_params.b);
#if wide
                if entry.kind == 2u {
                    x = array<vec4f, 2>(row.x_params.c, row.x_params.d);
                    y = array<vec4f, 2>(row.y_params.c, row.y_params.d);
                }
#endif
                for (var k = 0u; k < 4u; k += 1u) {
                    columns[k] += row.px * x[0][k] + row.py * y[0][k];
                    columns[4u + k] += row.px * x[1][k] + row.py * y[1][k];
                }
            }
            continue;
        }
        for (var k = 0u; k < MEMBERSHIPS; k += 1u) {
            let mode = modes[image * MEMBERSHIPS + k];
            if mode.cluster != entry.row || mode.weight == 0.0 {
                continue;
            }
            let row = row_of(point, view, intrinsics[view.camera], params.cell, point_weights(seen));
            let h = mode.weight * point_square(row);
            normal += h;
            columns[6] -= h * mode.from_center;
            arm = mode.inverse_radius * row.ray + mode.from_center;
        }
    }
    if entry.kind == 0u {
        for (var k = 0u; k < 3u; k += 1u) {
            columns[k] = -normal[k];
            columns[3u + k] = -(normal * cross(axis(k), arm));
        }
    }
    for (var k = 0u; k < 8u; k += 1u) {
        columns[k] = solve_row(block.damped_top.xyz, block.damped_bottom.xyz, columns[k]);
    }
    for (var c = 0u; c < 3u; c += 1u) {
        coarse_factors[6u * e + 2u * c] = vec4f(columns[0][c], columns[1][c], columns[2][c], columns[3][c]);
        coarse_factors[6u * e + 2u * c + 1u] = vec4f(columns[4][c], columns[5][c], columns[6][c], columns[7][c]);
    }
}
