//! An `f64` that knows how much was summed to get it.

use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use epipole_geometry::camera::{Real, Scalar};

/// A value with `Σ|terms|`: to first order, rounding every operation to a relative ε moves it by at most ε times that.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bounded {
    pub(crate) value: f64,
    pub(crate) terms: f64,
}

impl Add for Bounded {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, terms: self.terms + other.terms }
    }
}

impl Sub for Bounded {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, terms: self.terms + other.terms }
    }
}

impl Mul for Bounded {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let terms = self.value.abs() * other.terms + self.terms * other.value.abs();
        Self { value: self.value * other.value, terms }
    }
}

impl Div for Bounded {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, terms: (self.terms + value.abs() * other.terms) / other.value.abs() }
    }
}

impl Neg for Bounded {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, terms: self.terms }
    }
}

impl AddAssign for Bounded {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Bounded {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl MulAssign for Bounded {
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl Sum for Bounded {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), Add::add)
    }
}

impl PartialEq for Bounded {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl PartialOrd for Bounded {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl Bounded {
    /// A function of this number, with its slope there.
    fn mapped(self, value: f64, slope: f64) -> Self {
        Self { value, terms: value.abs() + slope.abs() * self.terms }
    }
}

impl Scalar for Bounded {
    fn constant(value: f64) -> Self {
        Self { value, terms: value.abs() }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn lowest(self) -> f64 {
        self.value
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        Self { value: root, terms: if root > 0.0 { root + 0.5 * self.terms / root } else { self.terms.sqrt() } }
    }
    fn sin(self) -> Self {
        self.mapped(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.mapped(self.value.cos(), self.value.sin())
    }
    fn tan(self) -> Self {
        let tan = self.value.tan();
        self.mapped(tan, 1.0 + tan * tan)
    }
    fn atan2(self, x: Self) -> Self {
        let value = self.value.atan2(x.value);
        let square = self.value * self.value + x.value * x.value;
        Self { value, terms: value.abs() + (x.value.abs() * self.terms + self.value.abs() * x.terms) / square }
    }
}

impl Real for Bounded {
    fn from_f64(value: f64) -> Self {
        Self::constant(value)
    }
    fn to_f64(self) -> f64 {
        self.value
    }
    fn abs(self) -> Self {
        Self { value: self.value.abs(), terms: self.terms }
    }
    fn max(self, other: Self) -> Self {
        if self.value >= other.value { self } else { other }
    }
    fn min(self, other: Self) -> Self {
        if self.value <= other.value { self } else { other }
    }
    fn is_finite(self) -> bool {
        self.value.is_finite()
    }
    const EPSILON: Self = Self { value: f64::EPSILON, terms: f64::EPSILON };
    const ZERO: Self = Self { value: 0.0, terms: 0.0 };
    const ONE: Self = Self { value: 1.0, terms: 1.0 };
}
