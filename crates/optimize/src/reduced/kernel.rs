//! The innermost loop of the assembly: `out −= E_a E_bᵀ` for two participants of a point.

/// Whether to use fused multiply-add. It changes the last bit, so it is decided once, by the machine, not by the thread.
#[inline(always)]
fn multiply_subtract<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { (-a).mul_add(b, c) } else { c - a * b }
}

#[inline(always)]
fn fixed<const FMA: bool, const ROWS: usize, const STRIDE: usize>(
    a: &[f64],
    b: &[f64],
    factor_stride: usize,
    out: &mut [f64],
) {
    let (a0, a1, a2) = (&a[..ROWS], &a[factor_stride..][..ROWS], &a[2 * factor_stride..][..ROWS]);
    let (b0, b1, b2) = (&b[..STRIDE], &b[factor_stride..][..STRIDE], &b[2 * factor_stride..][..STRIDE]);
    let out = &mut out[..ROWS * STRIDE];
    for row in 0..ROWS {
        let (x, y, z) = (a0[row], a1[row], a2[row]);
        let line = &mut out[row * STRIDE..][..STRIDE];
        for k in 0..STRIDE {
            let value = multiply_subtract::<FMA>(x, b0[k], line[k]);
            let value = multiply_subtract::<FMA>(y, b1[k], value);
            line[k] = multiply_subtract::<FMA>(z, b2[k], value);
        }
    }
}

/// As [`subtract_product`] where the lengths are known: `LEN` is three rows of `PITCH`.
#[inline(always)]
pub(super) fn subtract_fixed<
    const FMA: bool,
    const ROWS: usize,
    const STRIDE: usize,
    const PITCH: usize,
    const LEN: usize,
>(
    a: &[f64; LEN],
    b: &[f64; LEN],
    out: &mut [f64],
) {
    fixed::<FMA, ROWS, STRIDE>(a, b, PITCH, out);
}

#[inline(always)]
fn any<const FMA: bool>(rows: usize, stride: usize, a: &[f64], b: &[f64], factor_stride: usize, out: &mut [f64]) {
    for row in 0..rows {
        let (x, y, z) = (a[row], a[factor_stride + row], a[2 * factor_stride + row]);
        for k in 0..stride {
            let value = multiply_subtract::<FMA>(x, b[k], out[row * stride + k]);
            let value = multiply_subtract::<FMA>(y, b[factor_stride + k], value);
            out[row * stride + k] = multiply_subtract::<FMA>(z, b[2 * factor_stride + k], value);
        }
    }
}

/// `out −= E_a E_bᵀ`. `a` and `b` are `Eᵀ`: three rows of `factor_stride`; `out` has `rows` rows of `stride`.
#[inline(always)]
pub(super) fn subtract_product<const FMA: bool>(
    rows: usize,
    stride: usize,
    a: &[f64],
    b: &[f64],
    factor_stride: usize,
    out: &mut [f64],
) {
    match (rows, stride) {
        (6, 8) => fixed::<FMA, 6, 8>(a, b, factor_stride, out),
        (6, 4) => fixed::<FMA, 6, 4>(a, b, factor_stride, out),
        (3, 4) => fixed::<FMA, 3, 4>(a, b, factor_stride, out),
        (9, 12) => fixed::<FMA, 9, 12>(a, b, factor_stride, out),
        (7, 8) => fixed::<FMA, 7, 8>(a, b, factor_stride, out),
        (8, 8) => fixed::<FMA, 8, 8>(a, b, factor_stride, out),
        _ => any::<FMA>(rows, stride, a, b, factor_stride, out),
    }
}

/// A loop that can be compiled with or without fused multiply-add.
pub(crate) trait Vectorized {
    /// Runs the loop; implementations are `#[inline(always)]`.
    fn run<const FMA: bool>(self);
}

/// Runs the loop compiled for the widest registers this machine has.
#[inline]
pub(crate) fn dispatch<V: Vectorized>(work: V) {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        if let Some(v3) = pulp::x86::V3::try_new() {
            struct Fused<V>(V);
            impl<V: Vectorized> pulp::WithSimd for Fused<V> {
                type Output = ();
                #[inline(always)]
                fn with_simd<S: pulp::Simd>(self, _: S) {
                    self.0.run::<true>();
                }
            }
            return pulp::Simd::vectorize(v3, Fused(work));
        }
        work.run::<false>();
    }
    // AArch64 has fused multiply-add in its base set; WebAssembly does not.
    #[cfg(target_arch = "aarch64")]
    work.run::<true>();
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64")))]
    work.run::<false>();
}
