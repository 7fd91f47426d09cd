//! The CRFs against their oracle and their promises; inputs are seeded, and failures print the seed.
mod coarse;
mod gradient;
mod oracle;
mod promises;
mod sampled;
mod speed;

use super::scenes::{Random, Scene};
use std::vec;
use std::vec::Vec;

/// Workspace for a CRF of `E`, full of numbers that a read of unwritten memory would show.
pub(super) fn workspace<E: super::Energy<N>, const N: usize>(size: usize) -> Vec<u8> {
    vec![0x7f; super::workspace_bytes::<E, N>(size)]
}

/// |a - b| / |b|.
pub(super) fn relative_error(a: &[f32], b: &[f32]) -> f64 {
    let square = |v: f64| v * v;
    let error: f64 = a.iter().zip(b).map(|(a, b)| square(f64::from(*a) - f64::from(*b))).sum();
    let norm: f64 = b.iter().map(|b| square(f64::from(*b))).sum();
    (error / norm).sqrt()
}
