// Moves the observations of each track that count before those that do not, and says where they end: what then walks a
// track reads nothing in vain. No observation changes its track, so nothing else has to be renumbered but the places that
// the images' order refers to.

#import "common/dispatch.wgsl"
#import "bundle/types.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> tracks: array<u32>;
@group(0) @binding(2) var<storage, read_write> by_point: array<ByPoint>;
@group(0) @binding(3) var<storage, read_write> by_image: array<ByImage>;
@group(0) @binding(4) var<storage, read_write> image_order: array<u32>;
@group(0) @binding(5) var<storage, read_write> pixels: array<vec2f>;
@group(0) @binding(6) var<storage, read_write> residuals: array<Residual>;

fn exchange(a: u32, b: u32) {
    let observation = by_point[a];
    let pixel = pixels[a];
    let residual = residuals[a];
    let place = image_order[a];
    by_point[a] = by_point[b];
    pixels[a] = pixels[b];
    residuals[a] = residuals[b];
    image_order[a] = image_order[b];
    by_point[b] = observation;
    pixels[b] = pixel;
    residuals[b] = residual;
    image_order[b] = place;
    by_image[image_order[a]].index = a;
    by_image[place].index = b;
}

@compute @workgroup_size(64)
fn compact_point(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = linear_group(group, num_groups) * 64u + lane;
    if p >= params.points {
        return;
    }
    var next = tracks[p];
    var end = tracks[p + 1u];
    if params.compact == 1u {
        while next < end {
            if (by_point[next].image & OUT) == 0u {
                next += 1u;
            } else {
                end -= 1u;
                if (by_point[end].image & OUT) == 0u {
                    exchange(next, end);
                    next += 1u;
                }
            }
        }
    }
    tracks[track_end_at(params.points, p)] = end;
}
