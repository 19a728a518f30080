//! Exact differences of two states: a value before and after, and its change, each carried without cancellation.
//!
//! Subtracting two pixels computed in `f32` leaves noise of 1e-5 px whatever the size of the step; carrying the change
//! through every operation leaves a relative error of 1e-7 of the change itself (source: `solver.md` §1.3 d).
//! The state after the step is carried too: derived as `before + change` it would lose its digits wherever a step
//! brings a quantity close to zero.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::scalar::{Real, Scalar};

/// A value before a step, after it, and the change the step makes.
#[derive(Clone, Copy, Debug)]
pub struct Difference<T> {
    /// The value before the step.
    pub before: T,
    /// The value after the step.
    pub after: T,
    /// After minus before, more exactly than the subtraction would give it.
    pub change: T,
}

impl<T: Real> Difference<T> {
    /// A value and its change.
    #[inline(always)]
    pub fn new(before: T, change: T) -> Self {
        Self { before, after: before + change, change }
    }
}

impl<T: Real> Add for Difference<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { before: self.before + o.before, after: self.after + o.after, change: self.change + o.change }
    }
}

impl<T: Real> Sub for Difference<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { before: self.before - o.before, after: self.after - o.after, change: self.change - o.change }
    }
}

impl<T: Real> Neg for Difference<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { before: -self.before, after: -self.after, change: -self.change }
    }
}

impl<T: Real> Mul for Difference<T> {
    type Output = Self;
    /// `a'b' − ab = δa·b' + a·δb`.
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self {
            before: self.before * o.before,
            after: self.after * o.after,
            change: self.change * o.after + self.before * o.change,
        }
    }
}

impl<T: Real> Div for Difference<T> {
    type Output = Self;
    /// `a'/b' − a/b = (δa − (a/b)·δb)/b' = (δa − (a'/b')·δb)/b`; dividing by the larger denominator keeps the digits.
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let (inverse_before, inverse_after) = (T::ONE / o.before, T::ONE / o.after);
        let (before, after) = (self.before * inverse_before, self.after * inverse_after);
        let (quotient, inverse) =
            if o.before.abs() >= o.after.abs() { (after, inverse_before) } else { (before, inverse_after) };
        Self { before, after, change: (self.change - quotient * o.change) * inverse }
    }
}

impl<T: Real> AddAssign for Difference<T> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl<T: Real> SubAssign for Difference<T> {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}

impl<T: Real> MulAssign for Difference<T> {
    #[inline(always)]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl<T: Real> Scalar for Difference<T> {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        let value = T::from_f64(value);
        Self { before: value, after: value, change: T::ZERO }
    }
    #[inline(always)]
    fn value(self) -> f64 {
        self.before.to_f64()
    }
    #[inline(always)]
    fn lowest(self) -> f64 {
        self.before.min(self.after).to_f64()
    }
    /// `√a' − √a = δa/(√a' + √a)`.
    #[inline(always)]
    fn sqrt(self) -> Self {
        let (before, after) = (self.before.sqrt(), self.after.sqrt());
        let sum = before + after;
        Self { before, after, change: if sum > T::ZERO { self.change / sum } else { T::ZERO } }
    }
    /// `sin a' − sin a = 2 cos(a + δ/2) sin(δ/2)`.
    #[inline(always)]
    fn sin(self) -> Self {
        let half = self.change * T::from_f64(0.5);
        Self {
            before: self.before.sin(),
            after: self.after.sin(),
            change: T::from_f64(2.0) * (self.before + half).cos() * half.sin(),
        }
    }
    /// `cos a' − cos a = −2 sin(a + δ/2) sin(δ/2)`.
    #[inline(always)]
    fn cos(self) -> Self {
        let half = self.change * T::from_f64(0.5);
        Self {
            before: self.before.cos(),
            after: self.after.cos(),
            change: -T::from_f64(2.0) * (self.before + half).sin() * half.sin(),
        }
    }
    /// `tan a' − tan a = sin δ/(cos a · cos a')`.
    #[inline(always)]
    fn tan(self) -> Self {
        Self {
            before: self.before.tan(),
            after: self.after.tan(),
            change: self.change.sin() / (self.before.cos() * self.after.cos()),
        }
    }
    /// The angle between the directions before and after, by their cross and dot products.
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let cross = x.before * self.change - self.before * x.change;
        let dot = x.before * x.after + self.before * self.after;
        Self { before: self.before.atan2(x.before), after: self.after.atan2(x.after), change: cross.atan2(dot) }
    }
}
