// How similarities of a cluster of images move its images: the columns of Z, seven a cluster and an empty eighth, so that
// a block of the coarse matrix is 8 × 8 (source: scale.md §3.3). Lists of clusters are the end of the topology: their
// number, `clusters + 1` offsets, then members, each the place of its Mode.

#import "bundle/types.wgsl"
#import "bundle/topology.wgsl"

// Clusters an image may belong to, as MAX_MEMBERSHIPS in reduced/coarse/blending.rs.
const MEMBERSHIPS = 3u;
const NO_CLUSTER = 0xffffffffu;

// One image in one cluster: MEMBERSHIPS of them an image.
struct Mode {
    // (C − c)/ρ for the cluster's centre c and radius ρ.
    from_center: vec3f,
    inverse_radius: f32,
    cluster: u32,
    // As blended, and as it counts: 0 where an unknown of the pose is constant or out of the system.
    blended: f32,
    weight: f32,
    padding: u32,
}

// Rotation and centre.
struct PoseStep {
    rotation: vec3f,
    center: vec3f,
}

fn axis(k: u32) -> vec3f {
    return vec3f(f32(k == 0u), f32(k == 1u), f32(k == 2u));
}

// Column k of the pose's rows of Z.
fn pose_mode(mode: Mode, k: u32) -> PoseStep {
    if k < 3u {
        return PoseStep(vec3f(), mode.weight * axis(k));
    }
    if k < 6u {
        let e = axis(k - 3u);
        return PoseStep(-mode.weight * mode.inverse_radius * e, mode.weight * cross(e, mode.from_center));
    }
    return PoseStep(vec3f(), select(0.0, mode.weight, k == 6u) * mode.from_center);
}

fn clusters_at(images: u32, cameras: u32, big_cameras: u32, exact: u32) -> u32 {
    return exact_at(images, cameras, big_cameras) + 2u + exact;
}
