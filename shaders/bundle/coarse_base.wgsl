// The coarse matrix before points are eliminated: Zᵀ (B + λ diag B) Z, image by image from the plain sums that
// precondition_camera keeps. One workgroup a block of 8 × 8, one lane an entry. Rows of blocks are clusters, then eights
// of parameters of the cameras with an exact block, whose columns of Z are unit vectors.

#import "common/dispatch.wgsl"
#import "bundle/modes.wgsl"
#import "bundle/vectors.wgsl"
#import "bundle/block_sums.wgsl"
#import "bundle/coarse.wgsl"

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> topology: array<u32>;
@group(0) @binding(2) var<storage, read> modes: array<Mode>;
@group(0) @binding(3) var<storage, read> block_sums: array<f32>;
@group(0) @binding(4) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(5) var<storage, read> coarse_blocks: array<CoarseBlock>;
@group(0) @binding(6) var<storage, read_write> coarse_matrix: array<f32>;

fn component(step: PoseStep, k: u32) -> f32 {
    return select(step.center[k % 3u], step.rotation[k % 3u], k < 3u);
}

// One of the sums of all segments of an image.
fn image_sum(image: u32, k: u32) -> f32 {
    var sum = 0.0;
    for (var s = topology[image]; s < topology[image + 1u]; s += 1u) {
        sum += block_sums[s * SUMS + k];
    }
    return sum;
}

// xᵀ (B + λ diag B) y for an image's pose.
fn pose_product(image: u32, x: PoseStep, y: PoseStep) -> f32 {
    var sum = 0.0;
    var k = POSE_AT;
    for (var i = 0u; i < 6u; i += 1u) {
        for (var j = i; j < 6u; j += 1u) {
            let entry = image_sum(image, k);
            if i == j {
                sum += (entry + params.lambda * entry) * component(x, i) * component(y, i);
            } else {
                sum += entry * (component(x, i) * component(y, j) + component(x, j) * component(y, i));
            }
            k += 1u;
        }
    }
    return sum;
}

@compute @workgroup_size(64)
fn coarse_base(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) num_groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = linear_group(group, num_groups);
    if slot >= arrayLength(&coarse_blocks) {
        return;
    }
    let exact = exact_at(params.images, params.cameras, params.big_cameras);
    let at = exact + 2u + topology[exact];
    let clusters = topology[at];
    let members = at + clusters + 2u;
    let block = coarse_blocks[slot];
    let row = lane / 8u;
    let column = lane % 8u;
    var sum = 0.0;
    if block.row < clusters {
        for (var m = members + topology[at + 1u + block.row]; m < members + topology[at + 2u + block.row]; m += 1u) {
            let image = topology[m] / MEMBERSHIPS;
            let x = pose_mode(modes[topology[m]], row);
            if block.column < clusters {
                for (var k = 0u; k < MEMBERSHIPS; k += 1u) {
                    let other = modes[image * MEMBERSHIPS + k];
                    if other.cluster == block.column {
                        sum += pose_product(image, x, pose_mode(other, column));
                    }
                }
            } else if topology[camera_of_at(params.images, params.cameras) + image] == block.camera {
                let first = 6u + 8u * block.eighth;
                for (var i = 0u; i < 6u; i += 1u) {
                    sum += component(x, i) * image_sum(image, triangle_at(SIDE, i, first + column));
                }
            }
        }
    } else if block.row_camera == block.camera {
        let first = cameras_at(params.images) + block.camera;
        let i = 8u * block.row_eighth + row;
        let j = 8u * block.eighth + column;
        let entry = triangle_at(SIDE, 6u + min(i, j), 6u + max(i, j));
        for (var m = topology[first]; m < topology[first + 1u]; m += 1u) {
            sum += image_sum(topology[members_at(params.images, params.cameras) + m], entry);
        }
        if i == j {
            let units = params.images + params.cameras;
            let at = UNIT_VEC4 * (params.images + block.camera) + i / 4u;
            let scale = vectors[section(SCALE, units) + at][i % 4u];
            // The damping and the prior are in column scale. An empty column is left out.
            let added = (params.lambda + vectors[section(PRIOR_DIAGONAL, units) + at][i % 4u]) / max(scale * scale, 1e-30);
            sum = select(sum + added, 0.0, scale == 0.0);
        }
    }
    coarse_matrix[64u * slot + lane] = sum;
}
