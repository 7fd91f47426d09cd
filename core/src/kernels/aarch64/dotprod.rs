//! Dot products: `sdot` by element multiplies four channels' groups with one pixel's group. Tile: 8 pixels x 8 channels
//! in 16 registers, 4 pixels for what is left; a pixel's next four groups are one load.
#![allow(unsafe_code)]
use super::super::pack::{BLOCK, GROUP};
use super::super::{Block, Kernels, Requant};
use super::{HALF, Out, Tile, Walk, store, weights_start};
use crate::base::simd::Level;
use core::arch::aarch64::{int8x16_t, int32x4_t, vdupq_n_s32, vld1q_s8, vld1q_s32, vreinterpretq_s8_s32};
use core::arch::asm;

/// Pixels in a full tile, and in a tile of what is left.
const PIXELS: usize = 8;
const REST: usize = 4;

/// The kernels of [`Level::DotProd`].
pub(in super::super) static KERNELS: Kernels = Kernels {
    name: "dotprod-conv-i8",
    level: Level::DotProd,
    flip: 0,
    code_bytes: 1,
    conv: convolve,
    accumulate,
};

fn convolve(block: &Block<'_>, requant: &Requant<'_>, out: &mut [i8]) {
    // SAFETY: `Kernels::on` hands this table out only when the CPU has the features.
    unsafe { run(block, &mut Out::Codes(requant, out)) }
}

fn accumulate(block: &Block<'_>, out: &mut [i32]) {
    // SAFETY: as in `convolve`.
    unsafe { run(block, &mut Out::Sums(out)) }
}

#[target_feature(enable = "neon,dotprod")]
fn run(block: &Block<'_>, out: &mut Out<'_>) {
    for half in 0..block.shape.cout.div_ceil(HALF) {
        let mut walk = Walk::new(block);
        while walk.left > REST {
            multiply::<PIXELS>(block, &walk.take(), half, out);
        }
        if walk.left > 0 {
            multiply::<REST>(block, &walk.take(), half, out);
        }
    }
}

/// Adds four channels' dot products with group `LANE` of `input`. The intrinsic (`vdotq_laneq_s32`) is not stable in
/// the oldest compiler that we support.
#[inline]
#[target_feature(enable = "neon,dotprod")]
fn sdot<const LANE: i32>(mut acc: int32x4_t, weights: int8x16_t, input: int8x16_t) -> int32x4_t {
    // SAFETY: reads and writes these registers alone; the feature is enabled here.
    unsafe {
        asm!(
            "sdot {acc:v}.4s, {weights:v}.16b, {input:v}.4b[{lane}]",
            acc = inout(vreg) acc,
            weights = in(vreg) weights,
            input = in(vreg) input,
            lane = const LANE,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

/// Group `LANE` of N pixels with the half panel's group row at `weights`.
///
/// # Safety
/// `weights` must be readable for half a group row.
#[inline]
#[target_feature(enable = "neon,dotprod")]
unsafe fn add_group<const LANE: i32, const N: usize>(
    acc: &mut [[int32x4_t; 2]; N],
    weights: *const i8,
    input: &[int8x16_t; N],
) {
    // SAFETY: the caller's promise.
    let (low, high) = unsafe { (vld1q_s8(weights), vld1q_s8(weights.add(BLOCK / 4))) };
    for (acc, &input) in acc.iter_mut().zip(input) {
        acc[0] = sdot::<LANE>(acc[0], low, input);
        acc[1] = sdot::<LANE>(acc[1], high, input);
    }
}

#[target_feature(enable = "neon,dotprod")]
fn multiply<const N: usize>(block: &Block<'_>, tile: &Tile<N>, half: usize, out: &mut Out<'_>) {
    let groups = block.shape.groups();
    // SAFETY: `Block::new` checked one offset per packed channel.
    let offset: [int32x4_t; 2] =
        core::array::from_fn(|h| unsafe { vld1q_s32(block.offset.as_ptr().add(half * HALF + 4 * h)) });
    let mut acc = [offset; N];
    for row in 0..block.shape.height {
        // SAFETY: `Block::new` checked that the band reaches to the last group of the last pixel's last row
        // (`Geometry::band_len`) and that the weights are as long as their shape says; all reads lie before these ends.
        unsafe {
            let mut input = tile.starts.map(|start| block.band.as_ptr().add(start + row * block.pitch));
            let mut weights = block.weights.as_ptr().add(weights_start(block, half) + row * groups * BLOCK);
            for _ in 0..groups / 4 {
                let four = input.map(|input| vld1q_s8(input.cast()));
                add_group::<0, N>(&mut acc, weights, &four);
                add_group::<1, N>(&mut acc, weights.add(BLOCK), &four);
                add_group::<2, N>(&mut acc, weights.add(2 * BLOCK), &four);
                add_group::<3, N>(&mut acc, weights.add(3 * BLOCK), &four);
                weights = weights.add(4 * BLOCK);
                input = input.map(|input| input.add(4 * GROUP));
            }
            for _ in 0..groups % 4 {
                let one = input
                    .map(|input| vreinterpretq_s8_s32(vdupq_n_s32(input.cast::<i32>().read_unaligned())));
                add_group::<0, N>(&mut acc, weights, &one);
                weights = weights.add(BLOCK);
                input = input.map(|input| input.add(GROUP));
            }
        }
    }
    store(block, tile, half, acc, out);
}
