//! Matrix products: `smmla` multiplies two pixels with two channels, eight deep. Tile: 12 pixels x 8 channels in 24
//! registers, 4 pixels for what is left. Two group rows zipped by words are four `smmla` operands.
#![allow(unsafe_code)]
use super::super::pack::BLOCK;
use super::super::{Block, Kernels, Requant};
use super::{HALF, Out, Tile, Walk, store, weights_start};
use crate::base::simd::Level;
use core::arch::aarch64::{
    int8x16_t, int32x4_t, vcombine_s8, vcreate_s8, vdupq_n_s8, vld1q_s8, vld1q_s32, vreinterpretq_s8_s32,
    vreinterpretq_s32_s8, vreinterpretq_s32_s64, vreinterpretq_s64_s32, vzip1q_s32, vzip1q_s64, vzip2q_s32,
    vzip2q_s64,
};
use core::arch::asm;

/// Pixels in a full tile, and in a tile of what is left.
const PIXELS: usize = 12;
const REST: usize = 4;

/// The kernels of [`Level::I8mm`].
pub(in super::super) static KERNELS: Kernels =
    Kernels { name: "i8mm-conv-i8", level: Level::I8mm, flip: 0, code_bytes: 1, conv: convolve, accumulate };

fn convolve(block: &Block<'_>, requant: &Requant<'_>, out: &mut [i8]) {
    // SAFETY: `Kernels::on` hands this table out only when the CPU has the features.
    unsafe { run(block, &mut Out::Codes(requant, out)) }
}

fn accumulate(block: &Block<'_>, out: &mut [i32]) {
    // SAFETY: as in `convolve`.
    unsafe { run(block, &mut Out::Sums(out)) }
}

#[target_feature(enable = "neon,i8mm")]
fn run(block: &Block<'_>, out: &mut Out<'_>) {
    for half in 0..block.shape.cout.div_ceil(HALF) {
        let mut walk = Walk::new(block);
        while walk.left > 2 * REST {
            multiply::<PIXELS, { PIXELS / 2 }>(block, &walk.take(), half, out);
        }
        while walk.left > 0 {
            multiply::<REST, { REST / 2 }>(block, &walk.take(), half, out);
        }
    }
}

/// Two pixels' next two groups; the pointers move on behind them.
///
/// # Safety
/// `first` and `second` must be readable for 8 bytes.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn load(first: &mut *const u8, second: &mut *const u8) -> int8x16_t {
    let pair;
    // SAFETY: reads what the caller promises to be there; writes these registers alone.
    unsafe {
        asm!(
            "ldr {pair:d}, [{first}], #8",
            "ld1 {{{pair:v}.d}}[1], [{second}], #8",
            pair = out(vreg) pair,
            first = inout(reg) *first,
            second = inout(reg) *second,
            options(readonly, nostack, preserves_flags)
        );
    }
    pair
}

/// Adds the products of two pixels (rows of `pair`) and eight channels (four registers of two rows): sums are pixel 0
/// channels 0, 1, then pixel 1. The intrinsic (`vmmlaq_s32`) is not stable in the oldest compiler that we support, and
/// a compiler that orders loads and products itself runs out of registers.
#[inline]
#[target_feature(enable = "neon,i8mm")]
fn smmla(acc: &mut [int32x4_t; 4], pair: int8x16_t, weights: [int8x16_t; 4]) {
    let [a, b, c, d] = acc;
    // SAFETY: reads and writes these registers alone; the feature is enabled here.
    unsafe {
        asm!(
            "smmla {a:v}.4s, {pair:v}.16b, {v:v}.16b",
            "smmla {b:v}.4s, {pair:v}.16b, {w:v}.16b",
            "smmla {c:v}.4s, {pair:v}.16b, {x:v}.16b",
            "smmla {d:v}.4s, {pair:v}.16b, {y:v}.16b",
            a = inout(vreg) *a, b = inout(vreg) *b, c = inout(vreg) *c, d = inout(vreg) *d,
            pair = in(vreg) pair,
            v = in(vreg) weights[0], w = in(vreg) weights[1], x = in(vreg) weights[2], y = in(vreg) weights[3],
            options(nomem, nostack, preserves_flags)
        );
    }
}

/// Words of two group rows in turn: two channels of 8 weights each from four channels of 4 and 4.
#[inline]
#[target_feature(enable = "neon")]
fn zip(near: int8x16_t, far: int8x16_t) -> [int8x16_t; 2] {
    let (near, far) = (vreinterpretq_s32_s8(near), vreinterpretq_s32_s8(far));
    [vreinterpretq_s8_s32(vzip1q_s32(near, far)), vreinterpretq_s8_s32(vzip2q_s32(near, far))]
}

/// The pairs of double words of two registers: lower halves, upper halves.
#[inline]
#[target_feature(enable = "neon")]
fn transpose(a: int32x4_t, b: int32x4_t) -> [int32x4_t; 2] {
    let (a, b) = (vreinterpretq_s64_s32(a), vreinterpretq_s64_s32(b));
    [vreinterpretq_s32_s64(vzip1q_s64(a, b)), vreinterpretq_s32_s64(vzip2q_s64(a, b))]
}

/// N pixels as P pairs.
#[target_feature(enable = "neon,i8mm")]
fn multiply<const N: usize, const P: usize>(
    block: &Block<'_>,
    tile: &Tile<N>,
    half: usize,
    out: &mut Out<'_>,
) {
    const { assert!(N == 2 * P) };
    let groups = block.shape.groups();
    // SAFETY: `Block::new` checked one offset per packed channel.
    let offset: [int32x4_t; 2] =
        core::array::from_fn(|h| unsafe { vld1q_s32(block.offset.as_ptr().add(half * HALF + 4 * h)) });
    let ([a, b], [c, d]) = (transpose(offset[0], offset[0]), transpose(offset[1], offset[1]));
    let mut acc = [[a, b, c, d]; P];
    for row in 0..block.shape.height {
        // SAFETY: `Block::new` checked that the band reaches to the last group of the last pixel's last row
        // (`Geometry::band_len`) and that the weights are as long as their shape says; all reads lie before these ends.
        unsafe {
            let mut input = tile.starts.map(|start| block.band.as_ptr().add(start + row * block.pitch));
            let mut weights = block.weights.as_ptr().add(weights_start(block, half) + row * groups * BLOCK);
            for _ in 0..groups / 2 {
                let [a, b] = zip(vld1q_s8(weights), vld1q_s8(weights.add(BLOCK)));
                let [c, d] = zip(vld1q_s8(weights.add(BLOCK / 4)), vld1q_s8(weights.add(BLOCK + BLOCK / 4)));
                let [first, second, ..] = &mut input[..] else { return };
                let mut now = load(first, second);
                for p in 0..P {
                    // One pair ahead, for CPUs that wait for their loads.
                    let next = match &mut input[2 * p + 2..] {
                        [first, second, ..] => load(first, second),
                        _ => now,
                    };
                    smmla(&mut acc[p], now, [a, b, c, d]);
                    now = next;
                }
                weights = weights.add(2 * BLOCK);
            }
            if groups % 2 == 1 {
                let none = vdupq_n_s8(0);
                let [a, b] = zip(vld1q_s8(weights), none);
                let [c, d] = zip(vld1q_s8(weights.add(BLOCK / 4)), none);
                let one = |input: *const u8| vcreate_s8(u64::from(input.cast::<u32>().read_unaligned()));
                for (p, acc) in acc.iter_mut().enumerate() {
                    smmla(acc, vcombine_s8(one(input[2 * p]), one(input[2 * p + 1])), [a, b, c, d]);
                }
            }
        }
    }
    let mut sums = [offset; N];
    for (sums, [a, b, c, d]) in sums.as_chunks_mut::<2>().0.iter_mut().zip(acc) {
        let (low, high) = (transpose(a, b), transpose(c, d));
        *sums = [[low[0], high[0]], [low[1], high[1]]];
    }
    store(block, tile, half, sums, out);
}
