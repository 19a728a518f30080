//! Exact differences of two states: a value and its change, each carried without cancellation.
//!
//! Subtracting two pixels computed in `f32` leaves noise of 1e-5 px whatever the size of the step; carrying the change
//! through every operation leaves a relative error of 1e-7 of the change itself (source: `solver.md` §1.3 d).

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::scalar::{Real, Scalar};

/// A value before a step and the change the step makes.
#[derive(Clone, Copy, Debug)]
pub struct Difference<T> {
    /// The value before the step.
    pub before: T,
    /// After minus before.
    pub change: T,
}

impl<T: Real> Difference<T> {
    /// A value and its change.
    #[inline(always)]
    pub fn new(before: T, change: T) -> Self {
        Self { before, change }
    }

    #[inline(always)]
    fn after(self) -> T {
        self.before + self.change
    }
}

impl<T: Real> Add for Difference<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { before: self.before + o.before, change: self.change + o.change }
    }
}

impl<T: Real> Sub for Difference<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { before: self.before - o.before, change: self.change - o.change }
    }
}

impl<T: Real> Neg for Difference<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { before: -self.before, change: -self.change }
    }
}

impl<T: Real> Mul for Difference<T> {
    type Output = Self;
    /// `a'b' − ab = δa·b' + a·δb`.
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self { before: self.before * o.before, change: self.change * o.after() + self.before * o.change }
    }
}

impl<T: Real> Div for Difference<T> {
    type Output = Self;
    /// `a'/b' − a/b = (δa − (a/b)·δb)/b'`.
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let before = self.before / o.before;
        Self { before, change: (self.change - before * o.change) / o.after() }
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
        Self { before: T::from_f64(value), change: T::ZERO }
    }
    #[inline(always)]
    fn value(self) -> f64 {
        self.before.to_f64()
    }
    /// `√a' − √a = δa/(√a' + √a)`.
    #[inline(always)]
    fn sqrt(self) -> Self {
        let before = self.before.sqrt();
        let sum = before + self.after().sqrt();
        Self { before, change: if sum > T::ZERO { self.change / sum } else { T::ZERO } }
    }
    /// `sin a' − sin a = 2 cos(a + δ/2) sin(δ/2)`.
    #[inline(always)]
    fn sin(self) -> Self {
        let half = self.change * T::from_f64(0.5);
        Self { before: self.before.sin(), change: T::from_f64(2.0) * (self.before + half).cos() * half.sin() }
    }
    /// `cos a' − cos a = −2 sin(a + δ/2) sin(δ/2)`.
    #[inline(always)]
    fn cos(self) -> Self {
        let half = self.change * T::from_f64(0.5);
        Self { before: self.before.cos(), change: -T::from_f64(2.0) * (self.before + half).sin() * half.sin() }
    }
    /// `tan a' − tan a = sin δ/(cos a · cos a')`.
    #[inline(always)]
    fn tan(self) -> Self {
        Self { before: self.before.tan(), change: self.change.sin() / (self.before.cos() * self.after().cos()) }
    }
    /// The angle between the directions before and after, by their cross and dot products.
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let cross = x.before * self.change - self.before * x.change;
        let dot = x.before * x.after() + self.before * self.after();
        Self { before: self.before.atan2(x.before), change: cross.atan2(dot) }
    }
}
