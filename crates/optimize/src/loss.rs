//! Robust losses ρ(s) of a squared residual s, with the differences that LM decides on.

/// A loss of the squared residual `s` (px²). All have `ρ(s) → s` as `s → 0`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Loss {
    /// ρ(s) = s.
    #[default]
    Squared,
    /// ρ(s) = s for s ≤ δ², 2δ√s − δ² beyond; δ in px.
    Huber(f64),
    /// ρ(s) = c² ln(1 + s/c²); c in px.
    Cauchy(f64),
    /// ρ(s) = s c²/(c² + s), less than c² whatever the residual (Geman–McClure); c in px.
    GemanMcClure(f64),
}

impl Loss {
    /// Whether the scale is a positive finite number.
    pub fn is_valid(self) -> bool {
        match self {
            Self::Squared => true,
            Self::Huber(scale) | Self::Cauchy(scale) | Self::GemanMcClure(scale) => scale.is_finite() && scale > 0.0,
        }
    }

    /// ρ(s).
    #[inline]
    pub fn value(self, s: f64) -> f64 {
        match self {
            Self::Squared => s,
            Self::Huber(d) if s <= d * d => s,
            Self::Huber(d) => 2.0 * d * s.sqrt() - d * d,
            Self::Cauchy(c) => c * c * (s / (c * c)).ln_1p(),
            Self::GemanMcClure(c) => s / (1.0 + s / (c * c)),
        }
    }

    /// What ρ(s) stays below, for losses that stay below something.
    pub fn bound(self) -> Option<f64> {
        match self {
            Self::GemanMcClure(c) => Some(c * c),
            _ => None,
        }
    }

    /// The IRLS weight ρ'(s), in (0, 1].
    #[inline]
    pub fn weight(self, s: f64) -> f64 {
        match self {
            Self::Squared => 1.0,
            Self::Huber(d) if s <= d * d => 1.0,
            Self::Huber(d) => d / s.sqrt(),
            Self::Cauchy(c) => 1.0 / (1.0 + s / (c * c)),
            Self::GemanMcClure(c) => (1.0 + s / (c * c)).powi(-2),
        }
    }

    /// Curvature of ρ(‖r‖²) along r over that across it, `1 + 2sρ''/ρ'`: 1 for a squared loss, 0 where ρ grows linearly,
    /// negative where it flattens.
    #[inline]
    pub fn radial_curvature(self, s: f64) -> f64 {
        match self {
            Self::Squared => 1.0,
            Self::Huber(d) => f64::from(u8::from(s <= d * d)),
            Self::Cauchy(c) => (c * c - s) / (c * c + s),
            Self::GemanMcClure(c) => (c * c - 3.0 * s) / (c * c + s),
        }
    }

    /// ρ(s + Δ) − ρ(s) from Δ itself: as accurate as Δ is, however small beside s (source: `solver.md` §1.3 d).
    #[inline]
    pub fn difference(self, s: f64, change: f64) -> f64 {
        let after = (s + change).max(0.0);
        match self {
            Self::Squared => change,
            Self::Huber(d) => match (s <= d * d, after <= d * d) {
                (true, true) => change,
                (false, false) => 2.0 * d * change / (s.sqrt() + after.sqrt()),
                _ => self.value(after) - self.value(s),
            },
            Self::Cauchy(c) => {
                let ratio = change / (c * c + s);
                // −1 is the limit of a residual that falls to nothing from infinity; rounding may step past it.
                if ratio > -1.0 { c * c * ratio.ln_1p() } else { self.value(after) - self.value(s) }
            }
            Self::GemanMcClure(c) => change.max(-s) / ((1.0 + s / (c * c)) * (1.0 + after / (c * c))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOSSES: [Loss; 4] = [Loss::Squared, Loss::Huber(1.5), Loss::Cauchy(0.7), Loss::GemanMcClure(1.2)];

    #[test]
    fn weight_is_the_slope_of_the_value() {
        for loss in LOSSES {
            for s in [1e-3, 0.3, 2.0, 2.3, 50.0] {
                let h = 1e-6 * s;
                let slope = (loss.value(s + h) - loss.value(s - h)) / (2.0 * h);
                assert!((slope - loss.weight(s)).abs() < 1e-7, "{loss:?} {s}");
            }
        }
    }

    #[test]
    fn difference_agrees_with_the_values_and_keeps_tiny_changes() {
        for loss in LOSSES {
            for s in [1e-3, 0.3, 2.2, 50.0] {
                for change in [-0.9 * s, -0.1 * s, 0.5 * s, 20.0 * s] {
                    let direct = loss.value(s + change) - loss.value(s);
                    assert!((loss.difference(s, change) - direct).abs() < 1e-12 * (1.0 + s), "{loss:?} {s} {change}");
                }
                let tiny = 1e-14 * s;
                assert!((loss.difference(s, tiny) / (loss.weight(s) * tiny) - 1.0).abs() < 1e-6, "{loss:?} {s}");
            }
        }
    }
}
