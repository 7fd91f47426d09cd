//! Functions made of basic operations alone: loops over them vectorise, and their bits are the same everywhere.
//!
//! Errors are those of the tests below, against `libm` in f64. None branches; NaN gives NaN or a number.

/// 2^x to a relative 3e-7, x clamped to [-126, 126].
#[inline(always)]
#[must_use]
pub fn exp2(x: f32) -> f32 {
    // Adding 1.5 2^23 rounds to the nearest integer and leaves it in the lowest bits.
    const SHIFT: f32 = 12_582_912.0;
    let x = if x < 126.0 { x } else { 126.0 };
    let x = if x > -126.0 { x } else { -126.0 };
    let shifted = x + SHIFT;
    let f = x - (shifted - SHIFT);
    // Taylor's series on [-1/2, 1/2].
    let tail = 0.009_618_129 + f * (0.001_333_355_8 + f * 0.000_154_035_3);
    let p = 1.0 + f * (core::f32::consts::LN_2 + f * (0.240_226_5 + f * (0.055_504_11 + f * tail)));
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// log2(x) to 3e-7 of the larger of 1 and itself; x below the smallest normal number counts as that.
#[inline(always)]
#[must_use]
pub fn log2(x: f32) -> f32 {
    const ROOT_HALF: u32 = 0x3f35_04f3;
    let x = if x > f32::MIN_POSITIVE { x } else { f32::MIN_POSITIVE };
    let exponent = (x.to_bits().wrapping_sub(ROOT_HALF) as i32) >> 23;
    // In [sqrt(1/2), sqrt(2)).
    let m = f32::from_bits(x.to_bits().wrapping_sub((exponent << 23) as u32));
    let t = (m - 1.0) / (m + 1.0);
    let t2 = t * t;
    // log2 m = 2 / ln 2 artanh t.
    let series = 1.0 + t2 * (1.0 / 3.0 + t2 * (0.2 + t2 * (1.0 / 7.0 + t2 * (1.0 / 9.0))));
    exponent as f32 + 2.0 * core::f32::consts::LOG2_E * t * series
}

/// 1 / sqrt(x) for x > 0 to a relative 3e-7; finite at 0.
#[inline(always)]
#[must_use]
pub fn rsqrt(x: f32) -> f32 {
    let mut y = f32::from_bits(0x5f37_5a86_u32.wrapping_sub(x.to_bits() >> 1));
    let half = 0.5 * x;
    // Newton's steps: relative errors 2e-3, 5e-6, rounding.
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    y * (1.5 - half * y * y)
}

/// sqrt(x) for x >= 0 to a relative 4e-7.
#[inline(always)]
#[must_use]
pub fn sqrt(x: f32) -> f32 {
    x * rsqrt(x)
}

/// e^x to a relative 1e-6 for |x| up to 10, 1e-5 up to 87.
#[inline(always)]
#[must_use]
pub fn exp(x: f32) -> f32 {
    exp2(x * core::f32::consts::LOG2_E)
}

/// x^(1/2.2) for x in [0,1] to 5e-7.
#[inline(always)]
#[must_use]
pub fn gamma(x: f32) -> f32 {
    exp2(log2(x) * (1.0 / 2.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly spaced over [from, to], both ends included.
    fn range(from: f64, to: f64) -> impl Iterator<Item = f32> {
        (0..=200_000).map(move |i| (from + (to - from) * f64::from(i) / 200_000.0) as f32)
    }

    fn worst(inputs: impl Iterator<Item = f32>, error: impl Fn(f32) -> f64) -> f64 {
        inputs.map(error).fold(0.0, f64::max)
    }

    #[test]
    fn powers_of_two() {
        let error = |x: f32| (f64::from(exp2(x)) / libm::exp2(f64::from(x)) - 1.0).abs();
        let found = worst(range(-126.0, 126.0).chain(range(-2.0, 2.0)), error);
        assert!(found < 3e-7, "{found:e}");
        assert_eq!((exp2(0.0), exp2(-3.0), exp2(7.0)), (1.0, 0.125, 128.0));
        assert_eq!((exp2(1e9), exp2(-1e9)), (exp2(126.0), exp2(-126.0)));
        assert!(exp2(f32::NAN).is_nan() || exp2(f32::NAN).is_finite());
    }

    #[test]
    fn exponentials() {
        let error = |x: f32| (f64::from(exp(x)) / libm::exp(f64::from(x)) - 1.0).abs();
        let (near, far) = (worst(range(-10.0, 10.0), error), worst(range(-87.0, 87.0), error));
        assert!(near < 1e-6 && far < 1e-5, "{near:e} {far:e}");
    }

    #[test]
    fn logarithms() {
        let error = |x: f32| {
            let exact = libm::log2(f64::from(x));
            (f64::from(log2(x)) - exact).abs() / exact.abs().max(1.0)
        };
        let powers = range(-126.0, 127.9).map(libm::exp2f);
        let found = worst(range(0.5, 2.0).chain(range(1e-6, 1.0)).chain(powers), error);
        assert!(found < 3e-7, "{found:e}");
        assert_eq!((log2(1.0), log2(8.0), log2(0.0), log2(-1.0)), (0.0, 3.0, -126.0, -126.0));
    }

    #[test]
    fn roots() {
        let values = || range(1e-6, 4.0).chain(range(-100.0, 100.0).map(libm::exp2f));
        let inverse = worst(values(), |x| (f64::from(rsqrt(x)) * libm::sqrt(f64::from(x)) - 1.0).abs());
        let root = worst(values(), |x| (f64::from(sqrt(x)) / libm::sqrt(f64::from(x)) - 1.0).abs());
        assert!(inverse < 3e-7 && root < 4e-7, "{inverse:e} {root:e}");
        assert!(rsqrt(0.0).is_finite() && sqrt(0.0) == 0.0 && rsqrt(f32::NAN).is_nan());
    }

    #[test]
    fn gamma_of_the_whole_range() {
        let found = worst(range(0.0, 1.0).chain(range(0.0, 1e-3)), |x| {
            (f64::from(gamma(x)) - libm::pow(f64::from(x), 1.0 / 2.2)).abs()
        });
        assert!(found < 5e-7, "{found:e}");
        assert!((gamma(1.0) - 1.0).abs() < 1e-7);
    }
}
