//! Fully connected float layer: products are added one input after the other, starting from the bias.
use super::graph::Dense;

/// Runs the layer; `output` has one value per row of weights.
pub(super) fn run(dense: &Dense<'_>, input: &[f32], output: &mut [f32]) {
    for (row, (out, bias)) in output.iter_mut().zip(dense.bias.iter()).enumerate() {
        let weights = dense.weights.run(row, input.len());
        let sum = weights.iter().zip(input).fold(bias, |sum, (w, &x)| sum + w * x);
        *out = if dense.relu { sum.max(0.0) } else { sum };
    }
}
