//! Seeded property tests: the seed is printed, so that a failure can be run again.
use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseResult, TestRng, TestRunner};
use std::string::ToString;

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
