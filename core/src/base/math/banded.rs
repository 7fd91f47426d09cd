//! Cholesky's factorisation of a symmetric, positive definite matrix with a band, and solutions with it.
//!
//! The matrix is its upper triangle, a row of `stride` values for each unknown: itself and the `band` unknowns behind it, zeros
//! after that; then its factor, inverse pivots in front.
use super::sqrtf;
use super::sums::row_sum;

/// Least pivot: any positive value keeps a matrix definite whose rounding has taken more than it had.
const LEAST_PIVOT: f32 = 1e-4;

/// Values of a row that are worked on together.
const CHUNK: usize = 16;

/// Values from one row to the next: loops over what is left of a row run in whole chunks, into zeros.
pub(crate) fn stride(band: usize) -> usize {
    (band + CHUNK).next_multiple_of(CHUNK)
}

/// Makes the matrix its factor, one row taken off those behind it after the other.
#[inline(always)]
pub(crate) fn factorise(matrix: &mut [f32], stride: usize, band: usize) {
    let mut rest = matrix;
    while let Some((row, behind)) = core::mem::take(&mut rest).split_at_mut_checked(stride) {
        let Some((pivot, row)) = row.split_first_mut() else { return };
        let inverse = 1.0 / sqrtf(pivot.max(LEAST_PIVOT));
        *pivot = inverse;
        row.iter_mut().for_each(|value| *value *= inverse);
        for (t, behind) in behind.chunks_exact_mut(stride).enumerate().take(band) {
            let Some(own @ &[factor, ..]) = row.get(t..) else { break };
            subtract(factor, own, behind, band - t);
        }
        rest = behind;
    }
}

/// Makes the right side `values` the solution; returns its product with the right side.
#[inline(always)]
pub(crate) fn solve(factor: &[f32], stride: usize, band: usize, values: &mut [f32]) -> f64 {
    let mut sum = 0.0_f64;
    for (i, row) in factor.chunks_exact(stride).enumerate() {
        let Some(([inverse, row @ ..], [own, behind @ ..])) = Some(row).zip(values.get_mut(i..)) else {
            break;
        };
        *own *= inverse;
        sum += f64::from(*own) * f64::from(*own);
        subtract(*own, row, behind, band);
    }
    for (i, row) in factor.chunks_exact(stride).enumerate().rev() {
        let Some(([inverse, row @ ..], [own, behind @ ..])) = Some(row).zip(values.get_mut(i..)) else {
            break;
        };
        let row = row.get(..behind.len()).unwrap_or(row);
        let behind = behind.get(..row.len()).unwrap_or(behind);
        *own = (*own
            - row_sum(
                row,
                behind,
                #[inline(always)]
                |a, b| a * b,
            ))
            * inverse;
    }
    sum
}

/// values -= factor row for the first `len`, and for the rest of their last chunk, where the row holds zeros.
#[inline(always)]
fn subtract(factor: f32, row: &[f32], values: &mut [f32], len: usize) {
    let len = len.next_multiple_of(CHUNK).min(row.len()).min(values.len());
    let (Some(row), Some(values)) = (row.get(..len), values.get_mut(..len)) else { return };
    let ((row, row_end), (values, values_end)) = (row.as_chunks::<CHUNK>(), values.as_chunks_mut::<CHUNK>());
    for (values, row) in values.iter_mut().zip(row) {
        for (value, row) in values.iter_mut().zip(row) {
            *value -= factor * row;
        }
    }
    for (value, row) in values_end.iter_mut().zip(row_end) {
        *value -= factor * row;
    }
}
