//! Fully connected float layer: products are added one input after the other, starting from the bias.
use super::graph::Dense;

/// Runs the layer on its source's values and, if there is a second one, those of that; `output` has one value per row of
/// weights.
pub(super) fn run(dense: &Dense<'_>, [first, second]: [&[f32]; 2], output: &mut [f32]) {
    for (row, (out, bias)) in output.iter_mut().zip(dense.bias.iter()).enumerate() {
        let weights = dense.weights.run(row, first.len() + second.len());
        let inputs = first.iter().chain(second);
        let sum = weights.iter().zip(inputs).fold(bias, |sum, (w, &x)| sum + w * x);
        *out = if dense.relu { sum.max(0.0) } else { sum };
    }
}
