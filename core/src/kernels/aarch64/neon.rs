//! Advanced SIMD alone: `smull` and `smlal` add two products in 16 bits, `sadalp` adds neighbours into 32.
//!
//! Weights are within [-127, 127] (the model file's rule, checked at load), so two products are at most
//! 2 * 127 * 128 = 32512 and 16 bits hold them: nothing saturates, nothing wraps. Tile: 4 pixels x 8 channels in 16
//! registers.
//!
//! The inner loop is in assembly because a compiler that orders these instructions itself runs out of registers.
#![allow(unsafe_code)]
use super::super::pack::BLOCK;
use super::super::{Block, Kernels, Requant};
use super::{HALF, Out, Tile, Walk, store, weights_start};
use crate::base::simd::Level;
use core::arch::aarch64::{
    int8x16_t, int32x4_t, vaddq_s32, vdupq_n_s32, vget_low_s8, vld1q_s8, vld1q_s32, vmull_high_s8, vmull_s8,
    vpadalq_s16, vpaddq_s32, vreinterpretq_s8_s32,
};
use core::arch::asm;

/// Pixels in a tile.
const PIXELS: usize = 4;

/// The kernels of [`Level::Neon`].
pub(in super::super) static KERNELS: Kernels =
    Kernels { name: "neon-conv-i8", level: Level::Neon, flip: 0, code_bytes: 1, conv: convolve, accumulate };

fn convolve(block: &Block<'_>, requant: &Requant<'_>, out: &mut [i8]) {
    // SAFETY: `Kernels::on` hands this table out only when the CPU has the features.
    unsafe { run(block, &mut Out::Codes(requant, out)) }
}

fn accumulate(block: &Block<'_>, out: &mut [i32]) {
    // SAFETY: as in `convolve`.
    unsafe { run(block, &mut Out::Sums(out)) }
}

#[target_feature(enable = "neon")]
fn run(block: &Block<'_>, out: &mut Out<'_>) {
    for half in 0..block.shape.cout.div_ceil(HALF) {
        let mut walk = Walk::new(block);
        while walk.left > 0 {
            multiply(block, &walk.take(), half, out);
        }
    }
}

/// One pixel's next two groups, each in all four words; `input` moves on behind them.
///
/// # Safety
/// `input` must be readable for 8 bytes.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn load(input: &mut *const u8) -> [int8x16_t; 2] {
    let (near, far);
    // SAFETY: reads what the caller promises to be there; writes these registers alone.
    unsafe {
        asm!(
            "ld1r {{{near:v}.4s}}, [{input}], #4",
            "ld1r {{{far:v}.4s}}, [{input}], #4",
            input = inout(reg) *input,
            near = out(vreg) near,
            far = out(vreg) far,
            options(readonly, nostack, preserves_flags)
        );
    }
    [near, far]
}

/// Adds one pixel's two groups times two half group rows.
#[inline]
#[target_feature(enable = "neon")]
fn add_two_groups(
    acc: &mut [int32x4_t; 4],
    input: [int8x16_t; 2],
    near: [int8x16_t; 2],
    far: [int8x16_t; 2],
) {
    let [a, b, c, d] = acc;
    // SAFETY: reads and writes these registers alone; the feature is enabled here.
    unsafe {
        asm!(
            "smull {p:v}.8h, {n0:v}.8b, {x:v}.8b",
            "smull2 {q:v}.8h, {n0:v}.16b, {x:v}.16b",
            "smull {r:v}.8h, {n1:v}.8b, {x:v}.8b",
            "smull2 {s:v}.8h, {n1:v}.16b, {x:v}.16b",
            "smlal {p:v}.8h, {f0:v}.8b, {y:v}.8b",
            "smlal2 {q:v}.8h, {f0:v}.16b, {y:v}.16b",
            "smlal {r:v}.8h, {f1:v}.8b, {y:v}.8b",
            "smlal2 {s:v}.8h, {f1:v}.16b, {y:v}.16b",
            "sadalp {a:v}.4s, {p:v}.8h",
            "sadalp {b:v}.4s, {q:v}.8h",
            "sadalp {c:v}.4s, {r:v}.8h",
            "sadalp {d:v}.4s, {s:v}.8h",
            a = inout(vreg) *a, b = inout(vreg) *b, c = inout(vreg) *c, d = inout(vreg) *d,
            x = in(vreg) input[0], y = in(vreg) input[1],
            n0 = in(vreg) near[0], n1 = in(vreg) near[1], f0 = in(vreg) far[0], f1 = in(vreg) far[1],
            p = out(vreg) _, q = out(vreg) _, r = out(vreg) _, s = out(vreg) _,
            options(nomem, nostack, preserves_flags)
        );
    }
}

/// The same with one group.
///
/// # Safety
/// `input` must be readable for 4 bytes.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn add_group(acc: &mut [int32x4_t; 4], input: *const u8, weights: [int8x16_t; 2]) {
    // SAFETY: the caller's promise.
    let group = vreinterpretq_s8_s32(vdupq_n_s32(unsafe { input.cast::<i32>().read_unaligned() }));
    for (h, weights) in weights.into_iter().enumerate() {
        acc[2 * h] = vpadalq_s16(acc[2 * h], vmull_s8(vget_low_s8(weights), vget_low_s8(group)));
        acc[2 * h + 1] = vpadalq_s16(acc[2 * h + 1], vmull_high_s8(weights, group));
    }
}

#[target_feature(enable = "neon")]
fn multiply(block: &Block<'_>, tile: &Tile<PIXELS>, half: usize, out: &mut Out<'_>) {
    let groups = block.shape.groups();
    // Each word sums two of a channel's four products: words 0, 1 channel 0 (2, 4, 6), words 2, 3 the next channel.
    let mut acc = [[vdupq_n_s32(0); 4]; PIXELS];
    for row in 0..block.shape.height {
        // SAFETY: `Block::new` checked that the band reaches to the last group of the last pixel's last row
        // (`Geometry::band_len`) and that the weights are as long as their shape says; all reads lie before these ends.
        unsafe {
            let mut input = tile.starts.map(|start| block.band.as_ptr().add(start + row * block.pitch));
            let mut weights = block.weights.as_ptr().add(weights_start(block, half) + row * groups * BLOCK);
            for _ in 0..groups / 2 {
                let near = [vld1q_s8(weights), vld1q_s8(weights.add(BLOCK / 4))];
                let far = [vld1q_s8(weights.add(BLOCK)), vld1q_s8(weights.add(BLOCK + BLOCK / 4))];
                let mut now = load(&mut input[0]);
                for i in 0..PIXELS {
                    // One pixel ahead, for CPUs that wait for their loads.
                    let next = if i + 1 < PIXELS { load(&mut input[i + 1]) } else { now };
                    add_two_groups(&mut acc[i], now, near, far);
                    now = next;
                }
                weights = weights.add(2 * BLOCK);
            }
            if groups % 2 == 1 {
                let last = [vld1q_s8(weights), vld1q_s8(weights.add(BLOCK / 4))];
                for (acc, input) in acc.iter_mut().zip(input) {
                    add_group(acc, input, last);
                }
            }
        }
    }
    // SAFETY: `Block::new` checked one offset per packed channel.
    let offset: [int32x4_t; 2] =
        core::array::from_fn(|h| unsafe { vld1q_s32(block.offset.as_ptr().add(half * HALF + 4 * h)) });
    let sums = acc
        .map(|[a, b, c, d]| [vaddq_s32(vpaddq_s32(a, b), offset[0]), vaddq_s32(vpaddq_s32(c, d), offset[1])]);
    store(block, tile, half, sums, out);
}
