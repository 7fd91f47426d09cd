//! Seeded tests: a generator, and properties whose seed is printed, so that a failure can be run again.
use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseResult, TestRng, TestRunner};
use std::string::ToString;
use std::vec::Vec;

/// Runs `test` on `cases` values of `strategy`; `FLASHMAT_SEED` gives another seed than 1.
pub(crate) fn property<S: Strategy>(cases: u32, strategy: S, test: impl Fn(S::Value) -> TestCaseResult) {
    let seed: u64 = std::env::var("FLASHMAT_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    std::println!("FLASHMAT_SEED={seed}");
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    if let Err(error) = TestRunner::new_with_rng(config, rng).run(&strategy, test) {
        panic!("FLASHMAT_SEED={seed}: {}", error.to_string());
    }
}

/// SplitMix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `low..=high`.
    pub(crate) fn range(&mut self, low: usize, high: usize) -> usize {
        low + (self.next() % (high - low + 1) as u64) as usize
    }

    /// Uniform in [-1, 1).
    pub(crate) fn float(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    pub(crate) fn codes(&mut self, len: usize) -> Vec<i8> {
        (0..len).map(|_| self.next() as i8).collect()
    }

    /// Symmetric weights, the extremes often.
    pub(crate) fn weights(&mut self, len: usize) -> Vec<i8> {
        let one =
            |r: u64| if r & 0xF00 == 0 { if r & 1 == 0 { 127 } else { -127 } } else { (r as i8).max(-127) };
        (0..len).map(|_| one(self.next())).collect()
    }
}
