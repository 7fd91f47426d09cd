//! Kernels for AArch64: a tile is N output pixels x 8 channels (half a panel), and this file holds what all three levels
//! do alike: the walk over pixels, and the store.
//!
//! Every pixel has its own pointer here, so a tile is just the next N pixels, whatever row they are in.
#![allow(unsafe_code)]
pub(super) mod dotprod;
pub(super) mod i8mm;
pub(super) mod neon;

use super::pack::{BLOCK, PANEL};
use super::{Block, Requant};
use core::arch::aarch64::{
    float32x4_t, int32x4_t, vaddq_s32, vcombine_s16, vcvtnq_s32_f32, vcvtq_f32_s32, vdupq_n_f32, vdupq_n_s32,
    vld1q_f32, vmaxnmq_f32, vminnmq_f32, vmovn_s16, vmovn_s32, vmulq_f32, vst1_s8, vst1q_s32,
};

/// Channels in half a panel.
const HALF: usize = PANEL / 2;
/// Bytes of half a group row.
const HALF_BLOCK: usize = BLOCK / 2;

/// Where finished accumulators go.
enum Out<'a> {
    Codes(&'a Requant<'a>, &'a mut [i8]),
    Sums(&'a mut [i32]),
}

/// N pixels of a block that are computed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Tile<const N: usize> {
    /// Index (row-major) of the first pixel.
    first: usize,
    /// Pixels that count, 1 to N; the others repeat the last.
    count: usize,
    /// Each pixel's first input byte in the band.
    starts: [usize; N],
}

/// A block's pixels, in order.
#[derive(Clone, Debug)]
struct Walk {
    next: usize,
    left: usize,
    /// Column and first input byte of the next pixel, and of its row's first pixel.
    at: (usize, usize, usize),
    cols: usize,
    step: usize,
    row_step: usize,
}

impl Walk {
    const fn new(block: &Block<'_>) -> Self {
        let (left, cols, step, row_step) = (block.pixels(), block.cols, block.step, block.row_step);
        Self { next: 0, left, at: (0, 0, 0), cols, step, row_step }
    }

    /// The next N pixels; fewer than one must not be left.
    #[inline]
    fn take<const N: usize>(&mut self) -> Tile<N> {
        let (first, count, (column, start, row)) = (self.next, self.left.min(N), self.at);
        self.next += count;
        self.left -= count;
        if column + N < self.cols {
            self.at = (column + N, start + N * self.step, row);
            return Tile { first, count, starts: core::array::from_fn(|i| start + i * self.step) };
        }
        let mut last = start;
        let starts = core::array::from_fn(|i| {
            if i < count {
                let (column, start, row) = self.at;
                last = start;
                self.at = if column + 1 == self.cols {
                    (0, row + self.row_step, row + self.row_step)
                } else {
                    (column + 1, start + self.step, row)
                };
            }
            last
        });
        Tile { first, count, starts }
    }
}

/// Where the half panel's weights begin.
const fn weights_start(block: &Block<'_>, half: usize) -> usize {
    (half / 2) * block.shape.panel_len() + (half % 2) * HALF_BLOCK
}

/// Stores a tile's finished sums (offset included).
#[inline]
#[target_feature(enable = "neon")]
fn store<const N: usize>(
    block: &Block<'_>,
    tile: &Tile<N>,
    half: usize,
    sums: [[int32x4_t; 2]; N],
    out: &mut Out<'_>,
) {
    let (cout, first) = (block.shape.cout, half * HALF);
    let lanes = (cout - first).min(HALF);
    let at = tile.first * cout + first;
    match out {
        Out::Codes(requant, out) => {
            let (low, high) = requant.range.product_bounds();
            let zero_point = vdupq_n_s32(i32::from(requant.range.zero_point));
            // SAFETY: `Kernels::convolve` checked that there is one multiplier per packed channel.
            let multiplier: [float32x4_t; 2] = core::array::from_fn(|h| unsafe {
                vld1q_f32(requant.multiplier.as_ptr().add(first + 4 * h))
            });
            let code = |sum: int32x4_t, multiplier: float32x4_t| {
                let product = vmulq_f32(vcvtq_f32_s32(sum), multiplier);
                let clamped = vminnmq_f32(vmaxnmq_f32(product, vdupq_n_f32(low)), vdupq_n_f32(high));
                // Rounds half to even, whatever the rounding mode.
                vmovn_s32(vaddq_s32(vcvtnq_s32_f32(clamped), zero_point))
            };
            for (i, [a, b]) in sums.into_iter().enumerate() {
                if i < tile.count {
                    let codes = vmovn_s16(vcombine_s16(code(a, multiplier[0]), code(b, multiplier[1])));
                    let out = &mut out[at + i * cout..][..lanes];
                    let mut values = [0; HALF];
                    // SAFETY: both are 8 bytes long.
                    unsafe {
                        vst1_s8(if lanes == HALF { out.as_mut_ptr() } else { values.as_mut_ptr() }, codes);
                    }
                    if lanes != HALF {
                        out.copy_from_slice(&values[..lanes]);
                    }
                }
            }
        }
        Out::Sums(out) => {
            for (i, [a, b]) in sums.into_iter().enumerate() {
                if i < tile.count {
                    let mut values = [0; HALF];
                    // SAFETY: `values` is 8 words long.
                    unsafe {
                        vst1q_s32(values.as_mut_ptr(), a);
                        vst1q_s32(values.as_mut_ptr().add(HALF / 2), b);
                    }
                    out[at + i * cout..][..lanes].copy_from_slice(&values[..lanes]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;

    fn check<const N: usize>(rows: usize, cols: usize) {
        let (step, row_step) = (7, 1000);
        let mut walk = Walk { next: 0, left: rows * cols, at: (0, 0, 0), cols, step, row_step };
        let mut seen = vec![0; rows * cols];
        while walk.left > 0 {
            let tile = walk.take::<N>();
            assert!((1..=N).contains(&tile.count));
            for (i, &start) in tile.starts.iter().enumerate() {
                let pixel = tile.first + i.min(tile.count - 1);
                assert_eq!(start, pixel / cols * row_step + pixel % cols * step, "{rows} x {cols}, {tile:?}");
                seen[pixel] += usize::from(i < tile.count);
            }
        }
        assert!(seen.iter().all(|&s| s == 1), "{rows} x {cols}: {seen:?}");
    }

    #[test]
    fn every_pixel_is_in_one_tile() {
        for (rows, cols) in [(1, 1), (2, 2), (3, 4), (4, 7), (1, 13), (5, 128), (0, 4), (2, 3), (12, 1)] {
            check::<4>(rows, cols);
            check::<8>(rows, cols);
            check::<12>(rows, cols);
        }
    }
}
