// What an observation costs and how it is linearised, as in crates/optimize/src/positioning/block.rs.

#import "common/loss.wgsl"
#import "positioning/row.wgsl"

// ‖d‖² below this is a point on its camera.
const ON_CAMERA = 1e-30;

struct Linear {
    row: Row,
    // Of the cost, by δX − δC.
    gradient: vec3f,
    cost: f32,
    // 1 where it pulls at the point: not masked, not at the bound.
    pulls: f32,
}

fn masked(cost: f32) -> Linear {
    return Linear(Row(vec3f(), 0.0), vec3f(), cost, 0.0);
}

// What is kept of a row between kernels.
fn kept(row: Row) -> f32 {
    return select(row.scale, -row.scale, all(row.direction == vec3f()));
}

// ½ ω ρ(‖v − s d‖²) with the scale held at s.
fn held(v: vec3f, weight: f32, s: f32, d: vec3f, huber: f32) -> Linear {
    let u = v - s * d;
    let square = dot(u, u);
    let w = weight * loss_weight(LOSS_HUBER, huber, square);
    let cost = 0.5 * weight * loss_value(LOSS_HUBER, huber, square);
    return Linear(Row(vec3f(), sqrt(w) * s), -(w * s) * u, cost, 1.0);
}

// ω ‖d − ℓ v‖ with the best length of the ray.
fn deviation(v: vec3f, pin: f32, weight: f32, d: vec3f, bound: f32, delta: f32) -> Linear {
    let along = dot(v, d);
    let free = pin == 0.0 && along > bound;
    var length = max(along, bound);
    if pin > 0.0 {
        length = 1.0 / pin;
    }
    let r = d - length * v;
    let size = sqrt(dot(r, r));
    let w = weight / max(size, delta);
    return Linear(Row(select(vec3f(), v, free), sqrt(w)), w * r, weight * size, 1.0);
}

// ½ ω ρ(‖v − s d‖²) with the best scale s = max(s_min, vᵀd / ‖d‖²), eliminated (variable projection, Kaufman's form).
fn projected(v: vec3f, weight: f32, d: vec3f, huber: f32, least: f32) -> Linear {
    let square = dot(d, d);
    let s = dot(v, d) / max(square, ON_CAMERA);
    if s > least {
        var out = held(v, weight, s, d, huber);
        out.row.direction = d / sqrt(square);
        return out;
    }
    return masked(held(v, weight, least, d, huber).cost);
}

// What is known of a ray: where it points, and its share of its camera's ω, which is 1 unless it is pinned.
struct Ray {
    direction: vec3f,
    share: f32,
}

fn ray_of(stored: vec4f) -> Ray {
    if stored.w > 0.0 {
        let share = sqrt(dot(stored.xyz, stored.xyz));
        return Ray(stored.xyz / share, share);
    }
    return Ray(stored.xyz, 1.0);
}

// An observation with d = X − C. stored.w is 1 / ray length where it is known, 0 where not, negative where the
// observation is left out.
fn linearize(settings: Settings, stored: vec4f, camera_weight: f32, d: vec3f, least: f32) -> Linear {
    if stored.w < 0.0 {
        return masked(0.0);
    }
    let ray = ray_of(stored);
    let weight = camera_weight * ray.share;
    if settings.stage == LUD {
        return deviation(ray.direction, stored.w, weight, d, settings.bound, settings.delta);
    }
    if stored.w > 0.0 {
        return held(ray.direction, weight, stored.w, d, settings.huber_pinned);
    }
    if settings.stage == EQUAL_SCALES {
        return held(ray.direction, weight, settings.bound, d, settings.huber);
    }
    return projected(ray.direction, weight, d, settings.huber, least);
}
