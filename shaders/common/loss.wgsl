// Robust losses of a squared residual, as in crates/optimize/src/loss.rs.

const LOSS_SQUARED = 0u;
const LOSS_HUBER = 1u;
const LOSS_CAUCHY = 2u;
const LOSS_GEMAN_MCCLURE = 3u;

fn loss_value(loss: u32, scale: f32, s: f32) -> f32 {
    if loss == LOSS_HUBER && s > scale * scale {
        return scale * (2.0 * sqrt(s) - scale);
    }
    if loss == LOSS_CAUCHY {
        return scale * scale * log_one_plus(s / (scale * scale));
    }
    if loss == LOSS_GEMAN_MCCLURE {
        return s / (1.0 + s / (scale * scale));
    }
    return s;
}

fn loss_weight(loss: u32, scale: f32, s: f32) -> f32 {
    if loss == LOSS_HUBER && s > scale * scale {
        return scale / sqrt(s);
    }
    if loss == LOSS_CAUCHY {
        return 1.0 / (1.0 + s / (scale * scale));
    }
    if loss == LOSS_GEMAN_MCCLURE {
        let root = 1.0 / (1.0 + s / (scale * scale));
        return root * root;
    }
    return 1.0;
}

// ρ(s + change) − ρ(s) from the change itself.
fn loss_difference(loss: u32, scale: f32, s: f32, change: f32) -> f32 {
    let after = max(s + change, 0.0);
    if loss == LOSS_HUBER {
        let limit = scale * scale;
        if s > limit && after > limit {
            return 2.0 * scale * change / (sqrt(s) + sqrt(after));
        }
        if s > limit || after > limit {
            return loss_value(loss, scale, after) - loss_value(loss, scale, s);
        }
    }
    if loss == LOSS_CAUCHY {
        let ratio = change / (scale * scale + s);
        if ratio > -0.9 {
            return scale * scale * log_one_plus(ratio);
        }
        return loss_value(loss, scale, after) - loss_value(loss, scale, s);
    }
    if loss == LOSS_GEMAN_MCCLURE {
        let inverse = 1.0 / (scale * scale);
        return max(change, -s) / ((1.0 + s * inverse) * (1.0 + after * inverse));
    }
    return change;
}

// ln(1 + x). The sum would lose x where it is small; there five terms of the series are good to 1e-9.
fn log_one_plus(x: f32) -> f32 {
    if abs(x) < 0.015625 {
        return x * (1.0 - x * (0.5 - x * (0.33333334 - x * (0.25 - 0.2 * x))));
    }
    return log(1.0 + x);
}
