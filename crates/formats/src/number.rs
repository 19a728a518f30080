//! Numbers as text that read back to the same bits.

use std::fmt::Write;

/// Appends the shortest decimal that reads back to the same `f64` (never more than 17 significant digits).
pub(crate) fn push_f64(out: &mut String, value: f64) {
    let magnitude = value.abs();
    // Positional notation where it is short; the bounds are where C++ streams change over, too.
    let result = if magnitude == 0.0 || (1e-5..1e17).contains(&magnitude) || !value.is_finite() {
        write!(out, "{value}")
    } else {
        write!(out, "{value:e}")
    };
    debug_assert!(result.is_ok(), "writing to a String cannot fail");
}

/// Appends numbers separated by one space.
pub(crate) fn push_f64s(out: &mut String, values: &[f64]) {
    for (i, &value) in values.iter().enumerate() {
        if i > 0 {
            out.push(' ');
        }
        push_f64(out, value);
    }
}

/// The bits to store: one NaN for all NaNs, as text knows only one.
pub(crate) fn canonical_bytes(value: f64) -> [u8; 8] {
    if value.is_nan() { f64::NAN.to_le_bytes() } else { value.to_le_bytes() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_number_reads_back_to_the_same_bits(value: f64) {
            let mut text = String::new();
            push_f64(&mut text, value);
            let back: f64 = text.parse().expect("a number");
            prop_assert_eq!(canonical_bytes(back), canonical_bytes(value));
        }
    }
}
