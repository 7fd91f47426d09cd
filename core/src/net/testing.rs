//! Test help: a textbook convolution that shares nothing with the engine.
use super::band::Input;
use super::graph::Window;
use std::vec;
use std::vec::Vec;

/// sum w (q - zero point) over a window, padded with real zeros: `[side][side][cout]` in 64 bits.
pub(crate) fn correlate(
    inputs: &[Input<'_>],
    window: &Window,
    weights: &[i8],
    cout: usize,
    side: usize,
) -> Vec<i64> {
    let cin: usize = inputs.iter().map(|i| i.channels).sum();
    let mut out = vec![0; side * side * cout];
    let [top, left, ..] = window.pad;
    let at = |y: isize, x: isize, channel: usize| {
        let mut channel = channel;
        for input in inputs {
            if channel < input.channels {
                let scale = if input.upsample { 2 } else { 1 };
                let (y, x) = (y.div_euclid(scale), x.div_euclid(scale));
                let inside = (0..input.side as isize).contains(&y) && (0..input.side as isize).contains(&x);
                let index = (y as usize).wrapping_mul(input.side).wrapping_add(x as usize);
                return if inside {
                    i64::from(input.data[index * input.channels + channel]) - i64::from(input.zero_point)
                } else {
                    0
                };
            }
            channel -= input.channels;
        }
        0
    };
    for (index, out) in out.iter_mut().enumerate() {
        let (pixel, o) = (index / cout, index % cout);
        let (y0, x0) = ((pixel / side * window.stride) as isize, (pixel % side * window.stride) as isize);
        for ky in 0..window.height {
            for kx in 0..window.width {
                for c in 0..cin {
                    let w = weights[((o * window.height + ky) * window.width + kx) * cin + c];
                    let (y, x) = (y0 + ky as isize - top as isize, x0 + kx as isize - left as isize);
                    *out += i64::from(w) * at(y, x, c);
                }
            }
        }
    }
    out
}

/// The same with a kernel `[height][width]` for every channel: `[side][side][channels]`.
pub(crate) fn correlate_depthwise(
    input: &Input<'_>,
    window: &Window,
    weights: &[i8],
    side: usize,
) -> Vec<i64> {
    let (channels, [top, left, ..]) = (input.channels, window.pad);
    let mut out = vec![0; side * side * channels];
    for (index, out) in out.iter_mut().enumerate() {
        let (pixel, channel) = (index / channels, index % channels);
        for tap in 0..window.height * window.width {
            let y = (pixel / side * window.stride + tap / window.width).wrapping_sub(top);
            let x = (pixel % side * window.stride + tap % window.width).wrapping_sub(left);
            if y < input.side && x < input.side {
                let q = i64::from(input.data[(y * input.side + x) * channels + channel]);
                *out += i64::from(weights[tap * channels + channel]) * (q - i64::from(input.zero_point));
            }
        }
    }
    out
}
