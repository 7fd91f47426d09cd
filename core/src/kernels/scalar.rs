//! The definition of every kernel, in plain loops. Read by people and by tests; never tuned.
use super::pack::{BLOCK, GROUP, PANEL};
use super::{Block, Kernels, Level, Requant};

/// The kernels of [`Level::Scalar`].
pub(super) static KERNELS: Kernels =
    Kernels { name: "scalar-conv-i8", level: Level::Scalar, flip: 0, conv: convolve, accumulate };

/// Accumulators of 16 channels at one pixel, offset included.
fn panel_at(block: &Block<'_>, pixel: usize, panel: usize) -> [i32; PANEL] {
    let mut acc = [0; PANEL];
    acc.copy_from_slice(&block.offset[panel * PANEL..][..PANEL]);
    for row in 0..block.shape.height {
        let run = &block.band[block.pixel_start(pixel) + row * block.pitch..];
        for group in 0..block.shape.groups() {
            let start = panel * block.shape.panel_len() + (row * block.shape.groups() + group) * BLOCK;
            let weights = &block.weights[start..start + BLOCK];
            for (acc, weights) in acc.iter_mut().zip(weights.chunks_exact(GROUP)) {
                for (&q, &w) in run[group * GROUP..].iter().zip(weights) {
                    *acc = acc.wrapping_add(i32::from(q as i8) * i32::from(w));
                }
            }
        }
    }
    acc
}

fn convolve(block: &Block<'_>, requant: &Requant<'_>, out: &mut [i8]) {
    for (pixel, out) in out.chunks_exact_mut(block.shape.cout).enumerate() {
        for (panel, out) in out.chunks_mut(PANEL).enumerate() {
            let multipliers = &requant.multiplier[panel * PANEL..];
            for ((code, acc), &multiplier) in
                out.iter_mut().zip(panel_at(block, pixel, panel)).zip(multipliers)
            {
                *code = requant.range.requantise(acc, multiplier);
            }
        }
    }
}

fn accumulate(block: &Block<'_>, out: &mut [i32]) {
    for (pixel, out) in out.chunks_exact_mut(block.shape.cout).enumerate() {
        for (panel, out) in out.chunks_mut(PANEL).enumerate() {
            out.copy_from_slice(&panel_at(block, pixel, panel)[..out.len()]);
        }
    }
}
