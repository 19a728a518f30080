// What the priors of the cameras' parameters cost at the tried state, and by how much that is less than before, as an
// exact difference. One workgroup.

#import "common/tree.wgsl"
#import "bundle/types.wgsl"

const LANES = 256u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> intrinsics: array<Intrinsics>;
@group(0) @binding(2) var<storage, read> priors: array<Prior>;
@group(0) @binding(3) var<storage, read_write> vectors: array<vec4f>;

@compute @workgroup_size(256)
fn prior_camera(@builtin(local_invocation_index) lane: u32) {
    var decrease = 0.0;
    var cost = 0.0;
    for (var camera = lane; camera < params.cameras; camera += LANES) {
        let before = intrinsics[camera].params;
        let after = intrinsics[camera + params.cameras].params;
        let change = intrinsics[camera + 2u * params.cameras].params;
        let prior = priors[camera];
        let off = minus_units(after, prior.mean);
        cost += 0.5 * dot_units(multiply_units(prior.information, off), off);
        // (p − m)² − (p + δ − m)² = −δ (2 (p − m) + δ)
        let both = add_units(scale_unit(2.0, minus_units(before, prior.mean)), change);
        decrease -= 0.5 * dot_units(multiply_units(prior.information, change), both);
    }
    let total = reduce_eight(lane, Eight(vec4f(decrease, cost, 0.0, 0.0), vec4f()));
    if lane == 0u {
        vectors[1] = vec4f(vectors[1].xy, total.a.xy);
    }
}
