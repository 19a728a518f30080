// The root A = scale (I − direction directionᵀ) of an observation's block in δX − δC: two rows where its own scale is
// eliminated, three where it is held (direction zero) (source: solver.md §3.2).

#import "positioning/types.wgsl"

struct Row {
    direction: vec3f,
    scale: f32,
}

// From what is kept of a linearisation: the scale alone, negative where it is held, 0 where the observation is out.
// Nothing is known along the ray from camera to point, in LUD along the observed ray.
fn row_of(kept: f32, d: vec3f, ray: vec3f, stage: u32) -> Row {
    if kept <= 0.0 {
        return Row(vec3f(), -kept);
    }
    if stage == LUD {
        return Row(ray, kept);
    }
    return Row(d / sqrt(dot(d, d)), kept);
}

fn across(row: Row, e: vec3f) -> vec3f {
    return e - dot(row.direction, e) * row.direction;
}

// A e.
fn apply_root(row: Row, e: vec3f) -> vec3f {
    return row.scale * across(row, e);
}

// A A e.
fn apply_block(row: Row, e: vec3f) -> vec3f {
    return row.scale * row.scale * across(row, e);
}
