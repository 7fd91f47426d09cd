//! Transcendental functions, from `libm` in every build, so that `std` and `no_std` give the same bits; in loops
//! that are to vectorise, from [`approx`], whose errors are stated.
pub mod approx;
pub(crate) mod banded;
pub(crate) mod sums;

pub use libm::{
    atan2f, atanf, ceilf, cosf, exp2f, expf, fabsf, floorf, log2f, logf, powf, rintf, sinf, sqrtf, tanf,
    tanhf,
};

/// The logistic function 1 / (1 + e^-x), in (0,1).
#[must_use]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + expf(-x))
}
