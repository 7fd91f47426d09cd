//! Mean over space of an int8 image: exact integer sums, then `(sum / pixels) * scale` in single precision.
use super::graph::Tensor;

/// Means of each channel, in real units; `output` has one value per channel.
pub(super) fn run(tensor: &Tensor<'_>, input: &[i8], output: &mut [f32]) {
    let channels = tensor.channels.max(1);
    let pixels = input.len() / channels;
    for (channel, out) in output.iter_mut().enumerate() {
        let codes = input.iter().skip(channel).step_by(channels);
        let sum: i64 = codes.map(|&q| i64::from(q) - i64::from(tensor.zero_point)).sum();
        *out = sum as f32 / pixels as f32 * tensor.scale;
    }
}
