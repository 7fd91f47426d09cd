//! Test help: a seeded generator, and a textbook convolution that shares nothing with the engine.
use super::band::Input;
use super::graph::Window;
use super::quant::Range;
use std::vec;
use std::vec::Vec;

/// SplitMix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `low..=high`.
    pub(crate) fn range(&mut self, low: usize, high: usize) -> usize {
        low + (self.next() % (high - low + 1) as u64) as usize
    }

    /// Uniform in [-1, 1).
    pub(crate) fn float(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    pub(crate) fn codes(&mut self, len: usize) -> Vec<i8> {
        (0..len).map(|_| self.next() as i8).collect()
    }

    /// Symmetric weights, the extremes often.
    pub(crate) fn weights(&mut self, len: usize) -> Vec<i8> {
        let one =
            |r: u64| if r & 0xF00 == 0 { if r & 1 == 0 { 127 } else { -127 } } else { (r as i8).max(-127) };
        (0..len).map(|_| one(self.next())).collect()
    }
}

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

/// The requantisation rule in its textbook order, in double precision after the single product.
pub(crate) fn requantise(acc: i64, multiplier: f32, range: Range) -> i8 {
    let rounded = libm::rint(f64::from(acc as f32 * multiplier));
    (rounded + f64::from(range.zero_point)).clamp(f64::from(range.low), 127.0) as i8
}
