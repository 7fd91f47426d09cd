//! AVX2: activations (widened to 16 bits when the band is gathered) and weights (widened here) are multiplied with
//! `vpmaddwd`, which is exact; `vpmaddubsw`, which saturates, is never used. Tile: 4 pixels x 8 channels (half a panel) in
//! 8 registers.
#![allow(unsafe_code)]
use super::super::pack::{BLOCK, GROUP, PANEL};
use super::super::tiles::{Tile, Tiles};
use super::super::{Block, Kernels, Requant};
use crate::base::simd::Level;
use core::arch::x86_64::{
    __m256i, _mm_cvtsi128_si64, _mm_loadu_si128, _mm_packs_epi16, _mm_packs_epi32, _mm256_add_epi32,
    _mm256_castsi256_si128, _mm256_cvtepi8_epi16, _mm256_cvtepi32_ps, _mm256_cvtps_epi32,
    _mm256_extracti128_si256, _mm256_hadd_epi32, _mm256_loadu_ps, _mm256_loadu_si256, _mm256_madd_epi16,
    _mm256_max_ps, _mm256_min_ps, _mm256_mul_ps, _mm256_permute4x64_epi64, _mm256_set1_epi32,
    _mm256_set1_epi64x, _mm256_set1_ps, _mm256_setzero_si256, _mm256_storeu_si256,
};

/// Channels in half a panel.
const HALF: usize = PANEL / 2;

/// The kernels of [`Level::Avx2`].
pub(in super::super) static KERNELS: Kernels =
    Kernels { name: "avx2-conv-i8", level: Level::Avx2, flip: 0, code_bytes: 2, conv: convolve, accumulate };

/// Where finished accumulators go.
enum Out<'a> {
    Codes(&'a Requant<'a>, &'a mut [i8]),
    Sums(&'a mut [i32]),
}

fn convolve(block: &Block<'_>, requant: &Requant<'_>, out: &mut [i8]) {
    // SAFETY: `Kernels::on` hands this table out only when the CPU has the features.
    unsafe { run(block, &mut Out::Codes(requant, out)) }
}

fn accumulate(block: &Block<'_>, out: &mut [i32]) {
    // SAFETY: as in `convolve`.
    unsafe { run(block, &mut Out::Sums(out)) }
}

#[target_feature(enable = "avx2")]
fn run(block: &Block<'_>, out: &mut Out<'_>) {
    for half in 0..block.shape.cout.div_ceil(HALF) {
        for tile in Tiles::new(block, 1) {
            match tile.width {
                4 => multiply::<4>(block, &tile, half, out),
                3 => multiply::<3>(block, &tile, half, out),
                2 => multiply::<2>(block, &tile, half, out),
                _ => multiply::<1>(block, &tile, half, out),
            }
        }
    }
}

/// W neighbouring pixels with half a panel.
#[target_feature(enable = "avx2")]
fn multiply<const W: usize>(block: &Block<'_>, tile: &Tile, half: usize, out: &mut Out<'_>) {
    let (step, groups) = (block.step, block.shape.groups());
    let start = block.pixel_start(tile.pixels[0]);
    let panel_start = (half / 2) * block.shape.panel_len() + (half % 2) * (BLOCK / 2);
    // Each 32-bit lane sums two of a channel's four products: lanes 0, 1 channel 0, lanes 2, 3 channel 1, and so on.
    let mut acc = [[_mm256_setzero_si256(); 2]; W];
    for row in 0..block.shape.height {
        // SAFETY: `Block::new` checked that the band reaches to the last group of the last pixel's last row
        // (`Geometry::band_len`) and that the weights are as long as their shape says; all reads lie before these ends.
        unsafe {
            let mut input = block.band.as_ptr().add(start + row * block.pitch);
            let mut weights = block.weights.as_ptr().add(panel_start + row * groups * BLOCK);
            for _ in 0..groups {
                let low = _mm256_cvtepi8_epi16(_mm_loadu_si128(weights.cast()));
                let high = _mm256_cvtepi8_epi16(_mm_loadu_si128(weights.add(BLOCK / 4).cast()));
                for (i, pixel) in acc.iter_mut().enumerate() {
                    let four = input.add(i * step).cast::<i64>().read_unaligned();
                    let wide = _mm256_set1_epi64x(four);
                    pixel[0] = _mm256_add_epi32(pixel[0], _mm256_madd_epi16(wide, low));
                    pixel[1] = _mm256_add_epi32(pixel[1], _mm256_madd_epi16(wide, high));
                }
                input = input.add(2 * GROUP);
                weights = weights.add(BLOCK);
            }
        }
    }
    for (i, [low, high]) in acc.into_iter().enumerate() {
        // hadd works within 128-bit halves: channels 0, 1, 4, 5, 2, 3, 6, 7; the permutation puts them in order.
        let sums = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_hadd_epi32(low, high));
        store(block, tile.pixels[0] + i, half, sums, out);
    }
}

#[target_feature(enable = "avx2")]
fn store(block: &Block<'_>, pixel: usize, half: usize, sums: __m256i, out: &mut Out<'_>) {
    let (cout, first) = (block.shape.cout, half * HALF);
    let lanes = (cout - first).min(HALF);
    let at = pixel * cout + first;
    // SAFETY: `Block::new` checked one offset per packed channel.
    let offset = unsafe { _mm256_loadu_si256(block.offset.as_ptr().add(first).cast()) };
    let sums = _mm256_add_epi32(sums, offset);
    match out {
        Out::Codes(requant, out) => {
            let (low, high) = requant.range.product_bounds();
            // SAFETY: `Kernels::convolve` checked one multiplier per packed channel.
            let multiplier = unsafe { _mm256_loadu_ps(requant.multiplier.as_ptr().add(first)) };
            let product = _mm256_mul_ps(_mm256_cvtepi32_ps(sums), multiplier);
            let clamped = _mm256_min_ps(_mm256_max_ps(product, _mm256_set1_ps(low)), _mm256_set1_ps(high));
            // Rounds half to even: Rust code always runs in the default rounding mode.
            let zero_point = _mm256_set1_epi32(i32::from(requant.range.zero_point));
            let codes = _mm256_add_epi32(_mm256_cvtps_epi32(clamped), zero_point);
            let words = _mm_packs_epi32(_mm256_castsi256_si128(codes), _mm256_extracti128_si256::<1>(codes));
            let bytes = _mm_cvtsi128_si64(_mm_packs_epi16(words, words)).to_le_bytes();
            let out = &mut out[at..at + lanes];
            if let Some(eight) = out.first_chunk_mut::<HALF>() {
                *eight = bytes.map(u8::cast_signed);
            } else {
                out.iter_mut().zip(bytes).for_each(|(code, byte)| *code = byte.cast_signed());
            }
        }
        Out::Sums(out) => {
            let mut values = [0_i32; HALF];
            // SAFETY: `values` is 32 bytes long.
            unsafe { _mm256_storeu_si256(values.as_mut_ptr().cast(), sums) };
            out[at..at + lanes].copy_from_slice(&values[..lanes]);
        }
    }
}
