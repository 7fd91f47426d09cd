//! Sums in a fixed order, whatever the registers: the same bits at every level.

/// Running sums of a row's sum.
pub(crate) const SUMS: usize = 16;

/// The sum over a row: value i goes to running sum i modulo [`SUMS`].
#[inline(always)]
pub(crate) fn row_sum(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f32) -> f32 {
    let mut sums = [0.0_f32; SUMS];
    let (whole_a, rest_a) = a.as_chunks::<SUMS>();
    let (whole_b, rest_b) = b.as_chunks::<SUMS>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        for i in 0..SUMS {
            sums[i] += term(a[i], b[i]);
        }
    }
    for ((sum, &a), &b) in sums.iter_mut().zip(rest_a).zip(rest_b) {
        *sum += term(a, b);
    }
    sums.iter().sum()
}
