//! Fully connected float layer: products are added one input after the other, starting from the bias.
use super::graph::Dense;

/// Rows that are summed side by side: each sum waits for its last product, eight need not wait for one another.
const ROWS: usize = 8;

/// Runs the layer on its source's values and, if there is a second one, those of that; `output` has one value per row of
/// weights.
pub(super) fn run(dense: &Dense<'_>, [first, second]: [&[f32]; 2], output: &mut [f32]) {
    let inputs = first.len() + second.len();
    let mut bias = dense.bias.iter();
    for (block, out) in output.chunks_mut(ROWS).enumerate() {
        // Rows past the last are empty: their sums stay 0.
        let mut rows: [_; ROWS] =
            core::array::from_fn(|row| dense.weights.run(block * ROWS + row, inputs).iter());
        let mut sums: [f32; ROWS] = core::array::from_fn(|_| bias.next().unwrap_or(0.0));
        for &x in first.iter().chain(second) {
            for (sum, row) in sums.iter_mut().zip(&mut rows) {
                *sum += row.next().unwrap_or(0.0) * x;
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = if dense.relu { sum.max(0.0) } else { sum };
        }
    }
}
