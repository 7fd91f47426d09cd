//! The definition of every kernel, in plain loops. Read by people and by tests; never tuned.
use super::pack::{BLOCK, GROUP, PANEL};
use super::{Block, Kernels, Requant};
use crate::base::simd::Level;

/// The kernels of [`Level::Scalar`].
pub(super) static KERNELS: Kernels = Kernels {
    name: "scalar-conv-i8",
    level: Level::Scalar,
    flip: 0,
    code_bytes: 1,
    conv: convolve,
    accumulate,
};

/// Accumulators of 16 channels at one pixel, offset included.
fn panel_at(block: &Block<'_>, pixel: usize, panel: usize) -> [i32; PANEL] {
    let mut acc = [0; PANEL];
    acc.copy_from_slice(&block.offset[panel * PANEL..][..PANEL]);
    let panel_len = block.shape.panel_len();
    let weights = &block.weights[panel * panel_len..][..panel_len];
    let groups = block.shape.groups();
    for (row, weights) in weights.chunks_exact(groups * BLOCK).enumerate() {
        let run = &block.band[block.pixel_start(pixel) + row * block.pitch..][..groups * GROUP];
        for (four, weights) in run.as_chunks::<GROUP>().0.iter().zip(weights.as_chunks::<BLOCK>().0) {
            let [a, b, c, d] = four.map(|byte| i32::from(byte.cast_signed()));
            for (acc, &weights) in acc.iter_mut().zip(weights.as_chunks::<GROUP>().0) {
                let [p, q, r, s] = weights.map(i32::from);
                *acc = acc.wrapping_add(a * p + b * q + c * r + d * s);
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
