//! The numbers twins are evaluated with.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// An `f32`, or an `f64` that knows how much was summed to get it.
pub(crate) trait Num:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    fn of(value: f32) -> Self;
    fn root(self) -> Self;
    fn ln(self) -> Self;
    fn value(self) -> f64;
}

impl Num for f32 {
    fn of(value: f32) -> Self {
        value
    }
    fn root(self) -> Self {
        self.sqrt()
    }
    fn ln(self) -> Self {
        // The kernels switch to a series for small x; this is as accurate everywhere.
        self.ln_1p()
    }
    fn value(self) -> f64 {
        f64::from(self)
    }
}

/// A value with `Σ|terms|`: to first order, rounding every operation to a relative ε moves it by at most ε times that.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounded {
    pub(crate) value: f64,
    pub(crate) terms: f64,
}

impl Num for Bounded {
    fn of(value: f32) -> Self {
        Self { value: f64::from(value), terms: f64::from(value).abs() }
    }
    fn root(self) -> Self {
        let root = self.value.sqrt();
        Self { value: root, terms: if root > 0.0 { root + 0.5 * self.terms / root } else { self.terms.sqrt() } }
    }
    fn ln(self) -> Self {
        Self { value: self.value.ln_1p(), terms: self.value.ln_1p().abs() + self.terms / (1.0 + self.value).abs() }
    }
    fn value(self) -> f64 {
        self.value
    }
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

pub(crate) type Vec3<N> = [N; 3];

pub(crate) fn zero<N: Num, const W: usize>() -> [N; W] {
    [N::of(0.0); W]
}

pub(crate) fn add<N: Num, const W: usize>(a: [N; W], b: [N; W]) -> [N; W] {
    std::array::from_fn(|k| a[k] + b[k])
}

pub(crate) fn sub<N: Num, const W: usize>(a: [N; W], b: [N; W]) -> [N; W] {
    std::array::from_fn(|k| a[k] - b[k])
}

pub(crate) fn scale<N: Num, const W: usize>(a: [N; W], s: N) -> [N; W] {
    a.map(|v| v * s)
}

/// Sum of products, in order.
pub(crate) fn dot<N: Num>(a: &[N], b: &[N]) -> N {
    a.iter().zip(b).map(|(&x, &y)| x * y).reduce(|s, t| s + t).unwrap_or(N::of(0.0))
}

pub(crate) fn cross<N: Num>(a: Vec3<N>, b: Vec3<N>) -> Vec3<N> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The tree of `common/tree.wgsl` and `bundle/segment_tree.wgsl`; the number of lanes is a power of two.
pub(crate) fn tree<N: Num, const W: usize>(mut lanes: Vec<[N; W]>) -> [N; W] {
    let mut stride = lanes.len() / 2;
    while stride > 0 {
        for lane in 0..stride {
            lanes[lane] = add(lanes[lane], lanes[lane + stride]);
        }
        stride /= 2;
    }
    lanes[0]
}
