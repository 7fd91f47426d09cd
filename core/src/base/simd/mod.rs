//! Float loops compiled once per instruction set: written once, in plain Rust, so that every level gives the same bits.
//!
//! [`Simd::run`] inlines its closure into a function compiled for the level's vector registers, and LLVM vectorises
//! what it finds there. Rust never contracts `a * b + c`, and vectorised loops keep each lane's operations and their
//! order, so wider registers change the time alone. Closures must be `#[inline(always)]`, and what they call too: a
//! call that stays a call is compiled for the baseline.
#![allow(unsafe_code)]
mod level;
#[cfg(target_arch = "x86_64")]
mod sqrt;

use crate::Error;
pub use level::Level;

/// Proof that this CPU has the vector registers that float loops are to use.
///
/// A value: [`Simd::for_level`] checks the CPU, and nothing else makes one wider than the baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simd(Width);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Width {
    /// What the compiler may use anyway: SSE2 on x86-64, NEON on AArch64.
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// And AVX-512 VNNI and VBMI: the same loops, and tables of bytes in registers.
    #[cfg(target_arch = "x86_64")]
    Avx512Vbmi,
}

impl Simd {
    /// What every CPU of the target has.
    pub const BASELINE: Self = Self(Width::Baseline);

    /// The registers of `level`.
    ///
    /// # Errors
    /// [`Error::LevelUnsupported`] when this CPU (without `std`: this build) does not have it.
    pub fn for_level(level: Level) -> Result<Self, Error> {
        if !level.is_supported() {
            return Err(Error::LevelUnsupported { level });
        }
        #[cfg(target_arch = "x86_64")]
        if level == Level::Avx512Vnni {
            return Ok(Self(if level::has_vbmi() { Width::Avx512Vbmi } else { Width::Avx512 }));
        }
        #[cfg(target_arch = "x86_64")]
        if level != Level::Scalar && Level::Avx2.is_supported() {
            return Ok(Self(Width::Avx2));
        }
        Ok(Self::BASELINE)
    }

    /// Runs `body` in code compiled for these registers.
    #[inline(always)]
    pub(crate) fn run<R>(self, body: impl FnOnce() -> R) -> R {
        match self.0 {
            Width::Baseline => body(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `for_level` found AVX2 supported before it made this value.
            Width::Avx2 => unsafe { avx2(body) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `for_level` found AVX-512 F, BW and VL supported before it made this value.
            Width::Avx512 | Width::Avx512Vbmi => unsafe { avx512(body) },
        }
    }

    /// Replaces `values` by their square roots, rounded as IEEE 754 and `libm` round them. `core` has no root, and `libm`'s do not
    /// vectorise.
    pub(crate) fn sqrt(self, values: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        match self.0 {
            Width::Baseline => sqrt::sse2(values),
            // SAFETY: as in `run`.
            Width::Avx2 => unsafe { sqrt::avx2(values) },
            // SAFETY: as in `run`.
            Width::Avx512 | Width::Avx512Vbmi => unsafe { sqrt::avx512(values) },
        }
        #[cfg(not(target_arch = "x86_64"))]
        values.iter_mut().for_each(|value| *value = crate::base::math::sqrtf(*value));
    }

    /// Whether the CPU has AVX-512 F, BW, VL, VNNI and VBMI: tables of bytes can be looked up in registers.
    pub(crate) fn has_byte_tables(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return self.0 == Width::Avx512Vbmi;
        #[cfg(not(target_arch = "x86_64"))]
        false
    }
}

/// Asks for `values` to be brought near the core, where the architecture has an instruction for it.
#[inline(always)]
pub(crate) fn prefetch<T>(values: &[T]) {
    #[cfg(target_arch = "x86_64")]
    {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        for line in values.chunks((LINE / size_of::<T>().max(1)).max(1)) {
            // SAFETY: every x86-64 CPU has the instruction (SSE), and it reads nothing: any address will do.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast()) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}

/// Bytes of a cache line.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<R>(body: impl FnOnce() -> R) -> R {
    body()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
fn avx512<R>(body: impl FnOnce() -> R) -> R {
    body()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// A multiplication and an addition that a contraction would round differently.
    #[test]
    fn every_level_gives_the_same_bits() {
        let a: Vec<f32> = (0..1000).map(|i| 1.0 + (i * 7919 % 1009) as f32 * 1.1e-4).collect();
        let sums = |simd: Simd| {
            simd.run(
                #[inline(always)]
                || {
                    let mut out = [0.0_f32; 1000];
                    for (i, (out, a)) in out.iter_mut().zip(&a).enumerate() {
                        *out = a * a - 1.0 / (i as f32 + a);
                    }
                    out.map(f32::to_bits)
                },
            )
        };
        let baseline = sums(Simd::BASELINE);
        let mut checked = 0;
        for level in Level::ALL {
            match Simd::for_level(level) {
                Ok(simd) => {
                    assert_eq!(sums(simd), baseline, "{}", level.name());
                    checked += 1;
                }
                Err(error) => assert_eq!(error, Error::LevelUnsupported { level }),
            }
        }
        assert!(checked > 0 && Simd::for_level(Level::Scalar) == Ok(Simd::BASELINE));
    }

    /// `libm`'s root, which is the correctly rounded one, for lengths at and between those of registers.
    #[test]
    fn roots_are_rounded_correctly() {
        let special =
            [0.0, -0.0, f32::MIN_POSITIVE, f32::from_bits(1), f32::MAX, f32::INFINITY, -1.0, f32::NAN];
        let bits = (0..20_000_u32).map(|i| f32::from_bits(i.wrapping_mul(2_654_435_761) >> 1));
        let all: Vec<f32> = special.into_iter().chain(bits).collect();
        for level in Level::ALL {
            let simd = Simd::for_level(level).unwrap_or(Simd::BASELINE);
            for len in (0..70).chain([all.len()]) {
                let mut found = all[..len].to_vec();
                simd.sqrt(&mut found);
                for (found, value) in found.iter().zip(&all) {
                    let root = crate::base::math::sqrtf(*value);
                    let same = found.to_bits() == root.to_bits() || (found.is_nan() && root.is_nan());
                    assert!(same, "{} {value:e}: {found:e} {root:e}", level.name());
                }
            }
        }
    }

    #[test]
    fn no_level_contracts_products_and_sums() {
        let x: Vec<f32> = (0..1003).map(|i| 0.1 + (i * 7919 % 1000) as f32 * 1e-3).collect();
        let mut expected = x.clone();
        for (out, x) in expected.iter_mut().zip(&x) {
            // Each operation alone, rounded to single precision by way of double, in which it is exact or nearly so.
            let scaled = (f64::from(*out) * f64::from(1.000_1_f32)) as f32;
            let square = (f64::from(*x) * f64::from(*x)) as f32;
            *out = (f64::from(scaled) + f64::from(square)) as f32;
        }
        for level in Level::ALL {
            let (simd, mut out) = (Simd::for_level(level).unwrap_or(Simd::BASELINE), x.clone());
            let count = simd.run(
                #[inline(always)]
                || {
                    for (out, x) in out.iter_mut().zip(&x) {
                        *out = *out * 1.000_1 + x * x;
                    }
                    x.len()
                },
            );
            assert_eq!(count, x.len());
            assert_eq!(out, expected, "{}", level.name());
        }
    }
}
