// Lengths and best scales at the tried state, of the observations that medians are taken of.

#import "common/dispatch.wgsl"
#import "positioning/model.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> settings: Settings;
@group(0) @binding(2) var<storage, read> centers: array<vec4f>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> rays: array<vec4f>;
// Point, camera, place of the ray in the points' order, place among all samples.
@group(0) @binding(5) var<storage, read> samples: array<vec4u>;
// ‖d‖, and vᵀd / ‖d‖² or −1 where the point is behind the camera.
@group(0) @binding(6) var<storage, read_write> lengths: array<vec2f>;

@compute @workgroup_size(64)
fn position_sample(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let k = linear_group(group, num_groups) * 64u + lane;
    if k >= params.samples {
        return;
    }
    let sample = samples[k];
    let d = points[sample.x].s - centers[settings.cameras + sample.y].xyz;
    let square = dot(d, d);
    let best = dot(ray_of(rays[sample.z]).direction, d) / max(square, ON_CAMERA);
    lengths[sample.w] = vec2f(sqrt(square), select(-1.0, best, best > 0.0 && is_finite(best)));
}
