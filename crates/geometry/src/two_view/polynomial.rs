//! Real roots of small polynomials, which the minimal solvers end in.
//!
//! Sturm's theorem counts the roots in an interval from the signs of a short chain of polynomials; bisection isolates
//! them and a bracketed Newton iteration finishes. Roots outside [−1, 1] are those of the reversed polynomial inside:
//! no bound on the roots is needed and nothing overflows.

/// The largest number of coefficients: degree 10, from the five-point problem.
pub(super) const MAX_COEFFICIENTS: usize = 11;

/// Real roots, at most ten, in a fixed array.
#[derive(Clone, Copy, Debug)]
pub(super) struct Roots {
    values: [f64; MAX_COEFFICIENTS],
    len: usize,
}

impl Roots {
    const NONE: Self = Self { values: [0.0; MAX_COEFFICIENTS], len: 0 };

    fn push(&mut self, root: f64) {
        if self.len < MAX_COEFFICIENTS {
            self.values[self.len] = root;
            self.len += 1;
        }
    }

    pub(super) fn as_slice(&self) -> &[f64] {
        &self.values[..self.len]
    }
}

/// The real roots of Σ cᵢ xⁱ; `coefficients` holds the lowest power first.
pub(super) fn real_roots(coefficients: &[f64]) -> Roots {
    let mut roots = Roots::NONE;
    let n = coefficients.len();
    let largest = coefficients.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    if !(2..=MAX_COEFFICIENTS).contains(&n) || largest.is_nan() || largest <= 0.0 || !largest.is_finite() {
        return roots;
    }
    let mut forward = [0.0; MAX_COEFFICIENTS];
    let mut backward = [0.0; MAX_COEFFICIENTS];
    for i in 0..n {
        forward[i] = coefficients[i] / largest;
        backward[n - 1 - i] = coefficients[i] / largest;
    }
    for &x in roots_near_unit_interval(&forward[..n]).as_slice() {
        roots.push(x);
    }
    for &y in roots_near_unit_interval(&backward[..n]).as_slice() {
        // Beyond, the forward pass found it already (rounding may still repeat it); 0 is a root at infinity.
        if y.abs() < 1.0 / SPLIT && y.abs() > 1e-12 {
            roots.push(1.0 / y);
        }
    }
    roots
}

/// Where the forward pass hands over to the reversed one: near 1, but not a number that roots tend to be.
const SPLIT: f64 = 1.000_123_457;

/// Intervals narrower than this hold one cluster of roots that rounding cannot tell apart.
const CLUSTER_WIDTH: f64 = 1e-9;

fn roots_near_unit_interval(coefficients: &[f64]) -> Roots {
    let chain = SturmChain::new(coefficients);
    let mut roots = Roots::NONE;
    // Halving the interval down to a cluster takes about 32 splits, and each leaves one interval behind.
    let mut waiting = [(0.0, 0.0, 0, 0); 40];
    waiting[0] = (-SPLIT, SPLIT, chain.variations(-SPLIT), chain.variations(SPLIT));
    let mut len = 1;
    while len > 0 {
        len -= 1;
        let (low, high, at_low, at_high) = waiting[len];
        let count = at_low.saturating_sub(at_high);
        // Off the exact middle: a root on an end of an interval would have no sign change on either side.
        let middle = low + 0.487_654_321 * (high - low);
        if count == 1 {
            let (value_low, value_high) = (evaluate(coefficients, low), evaluate(coefficients, high));
            if (value_low < 0.0) != (value_high < 0.0) {
                roots.push(refine_root(coefficients, low, high, value_low));
            }
        } else if count > 1 && (high - low < CLUSTER_WIDTH || len + 2 > waiting.len()) {
            roots.push(middle);
        } else if count > 1 {
            let at_middle = chain.variations(middle);
            waiting[len] = (middle, high, at_middle, at_high);
            waiting[len + 1] = (low, middle, at_low, at_middle);
            len += 2;
        }
    }
    roots
}

/// A polynomial, its derivative, and the negated remainders of dividing each by the next.
struct SturmChain {
    coefficients: [[f64; MAX_COEFFICIENTS]; MAX_COEFFICIENTS],
    /// Number of coefficients of each.
    sizes: [usize; MAX_COEFFICIENTS],
    len: usize,
}

impl SturmChain {
    fn new(coefficients: &[f64]) -> Self {
        let mut chain =
            Self { coefficients: [[0.0; MAX_COEFFICIENTS]; MAX_COEFFICIENTS], sizes: [0; MAX_COEFFICIENTS], len: 0 };
        let mut derivative = [0.0; MAX_COEFFICIENTS];
        for i in 1..coefficients.len() {
            derivative[i - 1] = i as f64 * coefficients[i];
        }
        let mut next = chain.push(coefficients) && chain.push(&derivative[..coefficients.len() - 1]);
        while next {
            let (a, b) = (chain.len - 2, chain.len - 1);
            let (size_a, size_b) = (chain.sizes[a], chain.sizes[b]);
            if size_b < 2 {
                break;
            }
            let (mut remainder, divisor) = (chain.coefficients[a], &chain.coefficients[b]);
            let inverse = 1.0 / divisor[size_b - 1];
            for top in (size_b - 1..size_a).rev() {
                let factor = remainder[top] * inverse;
                let shift = top + 1 - size_b;
                for i in 0..size_b - 1 {
                    remainder[shift + i] -= factor * divisor[i];
                }
            }
            let negated = remainder.map(|x| -x);
            next = chain.push(&negated[..size_b - 1]);
        }
        chain
    }

    /// Appends the polynomial scaled to order one (signs are all that counts) without vanishing leading terms; false
    /// where nothing is left.
    fn push(&mut self, coefficients: &[f64]) -> bool {
        let largest = coefficients.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        if largest.is_nan() || largest <= 1e-15 || self.len == MAX_COEFFICIENTS {
            return false;
        }
        let mut size = coefficients.len();
        while coefficients[size - 1].abs() <= 1e-15 * largest {
            size -= 1;
        }
        let inverse = 1.0 / largest;
        for (to, from) in self.coefficients[self.len].iter_mut().zip(&coefficients[..size]) {
            *to = from * inverse;
        }
        self.sizes[self.len] = size;
        self.len += 1;
        true
    }

    /// Number of sign changes along the chain.
    fn variations(&self, x: f64) -> usize {
        let mut changes = 0;
        let mut last = 0.0;
        for k in 0..self.len {
            let value = evaluate(&self.coefficients[k][..self.sizes[k]], x);
            if value != 0.0 {
                changes += usize::from(value * last < 0.0);
                last = value.signum();
            }
        }
        changes
    }
}

fn evaluate(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, &c| sum * x + c)
}

/// Newton's method kept inside a shrinking bracket with a sign change.
fn refine_root(coefficients: &[f64], mut low: f64, mut high: f64, value_low: f64) -> f64 {
    let low_is_negative = value_low < 0.0;
    let mut x = 0.5 * (low + high);
    // Bisection alone needs 53 halvings of an interval of length 2; Newton's step usually ends after five.
    for _ in 0..60 {
        let (mut value, mut slope) = (0.0, 0.0);
        for &c in coefficients.iter().rev() {
            slope = slope * x + value;
            value = value * x + c;
        }
        if value == 0.0 {
            return x;
        }
        if (value < 0.0) == low_is_negative {
            low = x;
        } else {
            high = x;
        }
        let newton = x - value / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let step = (next - x).abs();
        x = next;
        if step <= 2e-16 * (1.0 + x.abs()) || high - low <= 2e-16 {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn from_roots(roots: &[f64]) -> Vec<f64> {
        let mut c = vec![1.0];
        for &r in roots {
            let mut next = vec![0.0; c.len() + 1];
            for (i, &a) in c.iter().enumerate() {
                next[i + 1] += a;
                next[i] -= r * a;
            }
            c = next;
        }
        c
    }

    #[test]
    fn finds_all_roots_inside_and_outside_the_unit_interval() {
        let truth = [-30.0, -2.5, -1.01, -0.4, 0.0, 0.1, 0.9, 0.99, 4.0, 55.0];
        let mut found = real_roots(&from_roots(&truth)).as_slice().to_vec();
        found.sort_by(f64::total_cmp);
        assert_eq!(found.len(), truth.len());
        for (f, t) in found.iter().zip(truth) {
            assert!((f - t).abs() < 1e-8 * (1.0 + t.abs()), "{f} {t}");
        }
    }

    #[test]
    fn no_real_roots_and_bad_coefficients_give_none() {
        assert!(real_roots(&[1.0, 0.0, 1.0]).as_slice().is_empty());
        assert!(real_roots(&[0.0; 11]).as_slice().is_empty());
        assert!(real_roots(&[f64::NAN; 4]).as_slice().is_empty());
        assert!(real_roots(&[f64::INFINITY, 1.0]).as_slice().is_empty());
        assert!(real_roots(&[3.0]).as_slice().is_empty());
    }

    proptest! {
        #[test]
        fn roots_are_sign_changes(c in proptest::collection::vec(-1.0f64..1.0, 4..=11)) {
            let scale: f64 = c.iter().map(|x| x.abs()).sum();
            for &x in real_roots(&c).as_slice() {
                let size = x.abs().max(1.0).powi(c.len() as i32 - 1);
                prop_assert!(evaluate(&c, x).abs() <= 1e-12 * scale * size);
            }
            // An odd degree always crosses zero.
            if c.len() % 2 == 0 && c.last().is_some_and(|l| l.abs() > 1e-3) {
                prop_assert!(!real_roots(&c).as_slice().is_empty());
            }
        }
    }
}
