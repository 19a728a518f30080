// What an observation costs: its pixel and, in the variant `depth`, its inverse depth with a loss of its own, as
// crates/optimize/src/bundle/cpu/rows.rs. The kernel declares `params`.

#import "common/loss.wgsl"
#import "bundle/types.wgsl"

fn cost_of(residual: Residual, e: Errors) -> f32 {
    let cost = loss_value(params.loss, params.loss_scale, dot(e.xy, e.xy));
#if depth
    let sigmas = residual.depth.w * e.z;
    return cost + loss_value(params.depth_loss, params.depth_loss_scale, sigmas * sigmas);
#else
    return cost;
#endif
}

// What the depth of an observation can cost at most, where its loss is bounded.
fn depth_bound(residual: Residual) -> f32 {
#if depth
    let is_bounded = params.depth_loss == LOSS_GEMAN_MCCLURE && residual.depth.w > 0.0;
    return select(0.0, params.depth_loss_scale * params.depth_loss_scale, is_bounded);
#else
    return 0.0;
#endif
}

// The cost counted from that bound: by it an observation is worth more in than out, which is then up to its pixel,
// however wrong its depth.
fn worth_of(residual: Residual, e: Errors) -> f32 {
    return cost_of(residual, e) - depth_bound(residual);
}

// The change of the cost where the errors change by `change`.
fn cost_change(residual: Residual, e: Errors, change: Errors) -> f32 {
    let pixel = loss_difference(params.loss, params.loss_scale, dot(e.xy, e.xy), dot(change.xy, 2.0 * e.xy + change.xy));
#if depth
    let sigmas = residual.depth.w * e.z;
    let more = residual.depth.w * change.z;
    return pixel
        + loss_difference(params.depth_loss, params.depth_loss_scale, sigmas * sigmas, more * (2.0 * sigmas + more));
#else
    return pixel;
#endif
}
