//! Dual numbers: a value and its derivatives with respect to `N` unknowns, for exact Jacobians of any model.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::scalar::{Real, Scalar};

/// A value with `N` partial derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Jet<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its partial derivatives.
    pub partials: [T; N],
}

impl<T: Real, const N: usize> Jet<T, N> {
    /// The `index`-th unknown at the given value.
    #[inline(always)]
    pub fn variable(value: T, index: usize) -> Self {
        let mut partials = [T::ZERO; N];
        partials[index] = T::ONE;
        Self { value, partials }
    }

    #[inline(always)]
    fn chain(self, value: T, slope: T) -> Self {
        Self { value, partials: self.partials.map(|d| d * slope) }
    }
}

impl<T: Real, const N: usize> Add for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, o: Self) -> Self {
        self += o;
        self
    }
}

impl<T: Real, const N: usize> AddAssign for Jet<T, N> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        self.value += o.value;
        for i in 0..N {
            self.partials[i] += o.partials[i];
        }
    }
}

impl<T: Real, const N: usize> Sub for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, o: Self) -> Self {
        self -= o;
        self
    }
}

impl<T: Real, const N: usize> SubAssign for Jet<T, N> {
    #[inline(always)]
    fn sub_assign(&mut self, o: Self) {
        self.value -= o.value;
        for i in 0..N {
            self.partials[i] -= o.partials[i];
        }
    }
}

impl<T: Real, const N: usize> Neg for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, partials: self.partials.map(|d| -d) }
    }
}

impl<T: Real, const N: usize> Mul for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let mut partials = [T::ZERO; N];
        for i in 0..N {
            partials[i] = self.partials[i] * o.value + self.value * o.partials[i];
        }
        Self { value: self.value * o.value, partials }
    }
}

impl<T: Real, const N: usize> MulAssign for Jet<T, N> {
    #[inline(always)]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl<T: Real, const N: usize> Div for Jet<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let inverse = T::ONE / o.value;
        let value = self.value * inverse;
        let mut partials = [T::ZERO; N];
        for i in 0..N {
            partials[i] = (self.partials[i] - value * o.partials[i]) * inverse;
        }
        Self { value, partials }
    }
}

impl<T: Real, const N: usize> Scalar for Jet<T, N> {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Self { value: T::from_f64(value), partials: [T::ZERO; N] }
    }
    #[inline(always)]
    fn value(self) -> f64 {
        self.value.to_f64()
    }
    #[inline(always)]
    fn lowest(self) -> f64 {
        self.value.to_f64()
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, T::from_f64(0.5) / root)
    }
    #[inline(always)]
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    #[inline(always)]
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    #[inline(always)]
    fn tan(self) -> Self {
        let t = self.value.tan();
        self.chain(t, T::ONE + t * t)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let inverse = T::ONE / (self.value * self.value + x.value * x.value);
        let mut partials = [T::ZERO; N];
        for i in 0..N {
            partials[i] = (x.value * self.partials[i] - self.value * x.partials[i]) * inverse;
        }
        Self { value: self.value.atan2(x.value), partials }
    }
}
