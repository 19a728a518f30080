// Centre and radius of each cluster at the accepted state, and from them its images' modes. One workgroup a cluster.

#import "common/dispatch.wgsl"
#import "common/tree.wgsl"
#import "bundle/modes.wgsl"
#import "bundle/vectors.wgsl"

const LANES = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> topology: array<u32>;
@group(0) @binding(2) var<storage, read> views: array<View>;
@group(0) @binding(3) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> modes: array<Mode>;

// Of the image's centre against that of another.
fn center_from(image: u32, origin: u32) -> vec3f {
    let a = views[image];
    let b = views[origin];
    let offset = vec3f(a.r0.w, a.r1.w, a.r2.w) - vec3f(b.r0.w, b.r1.w, b.r2.w);
    return params.cell * vec3f(a.cell - b.cell) + offset;
}

// A pose that may not move freely does not move with its cluster.
fn is_free(image: u32) -> bool {
    let at = section(SCALE, params.images + params.cameras) + UNIT_VEC4 * image;
    return all(vectors[at] != vec4f()) && all(vectors[at + 1u].xy != vec2f());
}

@compute @workgroup_size(64)
fn coarse_modes(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = clusters_at(params.images, params.cameras, params.big_cameras, topology[exact_at(params.images, params.cameras, params.big_cameras)]);
    let count = topology[at];
    let cluster = min(linear_group(group, num_groups), count - 1u);
    let members_at = at + count + 2u;
    let start = members_at + topology[at + 1u + cluster];
    let end = members_at + topology[at + 2u + cluster];
    let origin = topology[start] / MEMBERSHIPS;
    var sum = vec4f();
    for (var m = start + lane; m < end; m += LANES) {
        let member = topology[m];
        let image = member / MEMBERSHIPS;
        let weight = select(0.0, modes[member].blended, is_free(image));
        sum += weight * vec4f(center_from(image, origin), 1.0);
    }
    let total = reduce_eight(lane, Eight(sum, vec4f())).a;
    workgroupBarrier();
    let center = total.xyz / max(total.w, 1e-30);
    var spread = 0.0;
    for (var m = start + lane; m < end; m += LANES) {
        let member = topology[m];
        let image = member / MEMBERSHIPS;
        let weight = select(0.0, modes[member].blended, is_free(image));
        let arm = center_from(image, origin) - center;
        spread += weight * dot(arm, arm);
    }
    let square = reduce_eight(lane, Eight(vec4f(spread, 0.0, 0.0, 0.0), vec4f())).a.x / max(total.w, 1e-30);
    // One image, or several in one place: any length will do.
    let inverse_radius = select(1.0, inverseSqrt(max(square, 1e-30)), square > 1e-30);
    for (var m = start + lane; m < end; m += LANES) {
        let member = topology[m];
        let image = member / MEMBERSHIPS;
        modes[member].weight = select(0.0, modes[member].blended, is_free(image));
        modes[member].from_center = inverse_radius * (center_from(image, origin) - center);
        modes[member].inverse_radius = inverse_radius;
    }
}
