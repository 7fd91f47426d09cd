//! Planes as vectors: dot products and sums, the same bits on every CPU level and executor.
use crate::base::exec::{Executor, ROWS_PER_BLOCK, sum_row_blocks};
use crate::base::math::sums::row_sum;

/// Most channels of a map.
pub(super) const MAX_CHANNELS: usize = 3;

/// The plane from `at` on; empty past its end.
pub(super) fn tail(plane: &[f32], at: usize) -> &[f32] {
    plane.get(at..).unwrap_or(&[])
}

/// a^T b: rows of `width` values in 16 running f32 sums each, rows added up in f64.
#[must_use]
pub(super) fn dot(a: &[f32], b: &[f32], width: usize, exec: &dyn Executor) -> f64 {
    rows_sum(
        a,
        b,
        width,
        exec,
        #[inline(always)]
        |a, b| a * b,
    )
}

/// The sum of a plane, summed up like [`dot`].
#[must_use]
pub(super) fn sum(a: &[f32], width: usize, exec: &dyn Executor) -> f64 {
    rows_sum(
        a,
        a,
        width,
        exec,
        #[inline(always)]
        |a, _| a,
    )
}

/// r^T diagonal^-1 r.
pub(super) fn weighted_square(r: &[f32], diagonal: &[f32], width: usize, exec: &dyn Executor) -> f64 {
    rows_sum(
        r,
        diagonal,
        width,
        exec,
        #[inline(always)]
        |r, d| r * r / d,
    )
}

#[inline(always)]
fn rows_sum(
    a: &[f32],
    b: &[f32],
    width: usize,
    exec: &dyn Executor,
    term: impl Fn(f32, f32) -> f32 + Sync,
) -> f64 {
    let width = width.max(1);
    let rows = a.len().min(b.len()).div_ceil(width);
    let [sum] = sum_row_blocks(exec, 0..rows, ROWS_PER_BLOCK, &|rows| {
        let part = |plane| tail(plane, rows.start * width).chunks(width).take(rows.len());
        exec.simd().run(
            #[inline(always)]
            || {
                let mut sum = 0.0;
                for (a, b) in part(a).zip(part(b)) {
                    sum += f64::from(row_sum(a, b, &term));
                }
                [sum]
            },
        )
    });
    sum
}
