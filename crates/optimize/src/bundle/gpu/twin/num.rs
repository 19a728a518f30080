//! The numbers twins are evaluated with.

use epipole_geometry::camera::{Real, Scalar};

pub(crate) use super::bounded::Bounded;

/// An `f32`, or an `f64` that knows how much was summed to get it.
/// As a [`Real`] it also runs through `epipole_geometry`'s cameras.
pub(crate) trait Num: Real {
    fn of(value: f32) -> Self;
    fn root(self) -> Self;
    /// ln(1 + x).
    fn ln(self) -> Self;
    /// ln x.
    fn logarithm(self) -> Self;
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
    fn logarithm(self) -> Self {
        f32::ln(self)
    }
}

impl Num for Bounded {
    fn of(value: f32) -> Self {
        Self { value: f64::from(value), terms: f64::from(value).abs() }
    }
    fn root(self) -> Self {
        self.sqrt()
    }
    fn ln(self) -> Self {
        Self { value: self.value.ln_1p(), terms: self.value.ln_1p().abs() + self.terms / (1.0 + self.value).abs() }
    }
    fn logarithm(self) -> Self {
        let value = self.value.ln();
        Self { value, terms: value.abs() + self.terms / self.value.abs() }
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
