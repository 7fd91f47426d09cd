//! Plain loops compiled once for every level: the compiler's own vectors, as wide as the level has them.
//!
//! A [`Job`] is safe code; [`run`] calls it inside a function that has the level's instructions, into which it is
//! inlined. Bits cannot differ: Rust neither contracts products and sums nor reorders float operations.
#![allow(unsafe_code)]
use super::Level;

/// Work that gains from wide registers. Mark `run` and all that it calls in loops `#[inline(always)]`: a function that
/// is not inlined is compiled for the baseline.
pub(crate) trait Job {
    /// What it gives back.
    type Output;

    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs `job` with the instructions of `level`; of the baseline when this CPU lacks them.
#[inline]
pub(crate) fn run<J: Job>(level: Level, job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    if level.is_supported() {
        match level {
            // SAFETY: the CPU has what the level needs.
            Level::Avx2 => return unsafe { avx2(job) },
            // SAFETY: as above.
            Level::Avx512Vnni => return unsafe { avx512(job) },
            _ => {}
        }
    }
    let _ = level;
    job.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<J: Job>(job: J) -> J::Output {
    job.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
fn avx512<J: Job>(job: J) -> J::Output {
    job.run()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    struct Sum<'a>(&'a [f32], &'a mut [f32]);

    impl Job for Sum<'_> {
        type Output = usize;

        #[inline(always)]
        fn run(self) -> usize {
            for (out, x) in self.1.iter_mut().zip(self.0) {
                *out = *out * 1.000_1 + x * x;
            }
            self.0.len()
        }
    }

    #[test]
    fn the_same_bits_on_every_level() {
        let x: Vec<f32> = (0..1003).map(|i| 0.1 + (i * 7919 % 1000) as f32 * 1e-3).collect();
        let mut expected = x.clone();
        for (out, x) in expected.iter_mut().zip(&x) {
            // Each operation alone, rounded to single precision by way of double, in which it is exact or nearly so.
            let scaled = (f64::from(*out) * f64::from(1.000_1_f32)) as f32;
            let square = (f64::from(*x) * f64::from(*x)) as f32;
            *out = (f64::from(scaled) + f64::from(square)) as f32;
        }
        for level in Level::ALL {
            let mut out = x.clone();
            assert_eq!(run(level, Sum(&x, &mut out)), x.len());
            assert_eq!(out, expected, "{}", level.name());
        }
    }
}
