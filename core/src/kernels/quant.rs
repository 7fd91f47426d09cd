//! The one requantisation rule, and codes to real values.
//!
//! `y = clamp(round_half_even(acc as f32 * multiplier) + zero_point)`, all IEEE single operations in this order. The
//! engines clamp the product first, to integers, which commutes with the rounding and keeps every step finite.

/// 1.5 * 2^23: adding it to |x| < 2^22 rounds x to an integer, half to even, in the default rounding mode.
const ROUND: f32 = 12_582_912.0;

/// Rounds to the nearest integer, half to even; |x| below 2^22.
#[inline]
#[must_use]
pub fn round_half_even(x: f32) -> f32 {
    (x + ROUND) - ROUND
}

/// Where a convolution's results are cut off, and the code of real zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Code of real zero.
    pub zero_point: i8,
    /// Lowest code: -128, or the zero point with ReLU.
    pub low: i8,
}

impl Range {
    /// The range of an output with this zero point.
    #[must_use]
    pub const fn new(zero_point: i8, relu: bool) -> Self {
        Self { zero_point, low: if relu { zero_point } else { i8::MIN } }
    }

    /// Lowest and highest rounded product: the codes' bounds less the zero point.
    #[must_use]
    pub fn product_bounds(self) -> (f32, f32) {
        let zero_point = f32::from(self.zero_point);
        (f32::from(self.low) - zero_point, 127.0 - zero_point)
    }

    /// The code of an accumulator.
    #[inline]
    #[must_use]
    pub fn requantise(self, acc: i32, multiplier: f32) -> i8 {
        let (low, high) = self.product_bounds();
        let product = (acc as f32 * multiplier).max(low).min(high);
        (round_half_even(product) + f32::from(self.zero_point)) as i8
    }

    /// [`Range::requantise`], bit for bit, in operations that vectorise: minimum and maximum as x86-64 has them, and
    /// the rounded product read out of the low bits of its sum with [`ROUND`] instead of converted.
    #[inline(always)]
    pub(crate) fn requantise_lane(self, acc: i32, multiplier: f32) -> i8 {
        let (low, high) = self.product_bounds();
        let product = acc as f32 * multiplier;
        let product = if product > low { product } else { low };
        let product = if product < high { product } else { high };
        let rounded = (product + ROUND).to_bits().wrapping_sub(ROUND.to_bits()).cast_signed();
        (rounded + i32::from(self.zero_point)) as i8
    }
}

/// The int8 code of a real weight in units of `scale`, symmetric: within [-127, 127].
#[inline]
#[must_use]
pub fn weight_code(weight: f32, scale: f32) -> i8 {
    round_half_even((weight / scale).clamp(-127.0, 127.0)) as i8
}

/// The real value of a code.
#[inline]
#[must_use]
pub fn dequantise(code: i8, scale: f32, zero_point: i8) -> f32 {
    scale * f32::from(i16::from(code) - i16::from(zero_point))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_go_to_even() {
        for (x, y) in [
            (0.5, 0.0),
            (1.5, 2.0),
            (2.5, 2.0),
            (-0.5, 0.0),
            (-1.5, -2.0),
            (0.499_999_97, 0.0),
            (127.4, 127.0),
        ] {
            assert_eq!(round_half_even(x), y);
            assert_eq!(libm::rintf(x), y);
        }
    }

    #[test]
    fn hand_worked_codes() {
        let linear = Range::new(-3, false);
        assert_eq!([1, 3, 5, -1, -3].map(|acc| linear.requantise(acc, 0.5)), [-3, -1, -1, -3, -5]);
        assert_eq!(linear.requantise(i32::MAX, 1.0), 127);
        assert_eq!(linear.requantise(i32::MIN, f32::MAX), -128);
        // A multiplier may be infinite: a zero accumulator then gives the lowest code.
        for (acc, code) in [(i32::MAX, 127), (i32::MIN, -128), (0, -128), (1, 127)] {
            let codes = (linear.requantise(acc, f32::INFINITY), linear.requantise_lane(acc, f32::INFINITY));
            assert_eq!(codes, (code, code));
        }
        let relu = Range::new(-128, true);
        assert_eq!(relu.requantise(-5, 1.0), -128);
        assert_eq!(relu.requantise(300, 1.0), 127);
        assert_eq!(relu.requantise(255, 1.0), 127);
        assert_eq!(relu.requantise(254, 1.0), 126);
        assert_eq!(weight_code(1.0, 0.01), 100);
        assert_eq!(dequantise(-128, 0.5, -128), 0.0);
        assert_eq!(dequantise(127, 1.0 / 255.0, -128), 1.0);
    }

    /// The rule in its textbook order: round, add, clamp, in double precision after the single product.
    #[test]
    fn clamping_first_changes_nothing() {
        let mut state = 0x1234_5678_9ABC_DEF0_u64;
        for _ in 0..200_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let acc = (state >> 40) as i32 - (1 << 23);
            let multiplier = ((state >> 16 & 0xFFFF) as f32 + 1.0) * 1e-7;
            let range = Range::new((state >> 8) as i8, state & 1 == 1);
            let rounded = libm::rint(f64::from(acc as f32 * multiplier));
            let code = (rounded + f64::from(range.zero_point)).clamp(f64::from(range.low), 127.0);
            assert_eq!(f64::from(range.requantise(acc, multiplier)), code, "{acc} {multiplier} {range:?}");
            assert_eq!(
                f64::from(range.requantise_lane(acc, multiplier)),
                code,
                "{acc} {multiplier} {range:?}"
            );
        }
    }
}
