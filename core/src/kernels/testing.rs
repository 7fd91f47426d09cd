//! Test help: the rule that kernels round by, in its textbook order.
use super::quant::Range;

/// The requantisation rule in its textbook order, in double precision after the single product.
pub(crate) fn requantise(acc: i64, multiplier: f32, range: Range) -> i8 {
    let rounded = libm::rint(f64::from(acc as f32 * multiplier));
    (rounded + f64::from(range.zero_point)).clamp(f64::from(range.low), 127.0) as i8
}
