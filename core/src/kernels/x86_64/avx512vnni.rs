//! AVX-512 VNNI: `vpdpbusd` multiplies unsigned activations (code + 128: the band is flipped) with signed weights,
//! four products per 32-bit lane, without saturation. Tile: 12 pixels x 32 channels in 24 registers.
#![allow(unsafe_code)]
use super::super::pack::{BLOCK, GROUP, PANEL};
use super::super::tiles::{MAX_RUNS, Tile, Tiles};
use super::super::{Block, Kernels, Requant};
use crate::base::simd::Level;
use core::arch::x86_64::{
    __m512i, _MM_FROUND_NO_EXC, _MM_FROUND_TO_NEAREST_INT, _mm_mask_storeu_epi8, _mm512_add_epi32,
    _mm512_cvt_roundps_epi32, _mm512_cvtepi32_epi8, _mm512_cvtepi32_ps, _mm512_dpbusd_epi32, _mm512_loadu_ps,
    _mm512_loadu_si512, _mm512_mask_storeu_epi32, _mm512_max_ps, _mm512_min_ps, _mm512_mul_ps,
    _mm512_set1_epi32, _mm512_set1_ps,
};

/// The kernels of [`Level::Avx512Vnni`].
pub(in super::super) static KERNELS: Kernels = Kernels {
    name: "avx512vnni-conv-i8",
    level: Level::Avx512Vnni,
    flip: 0x80,
    code_bytes: 1,
    conv: convolve,
    accumulate,
};

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

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
fn run(block: &Block<'_>, out: &mut Out<'_>) {
    let panels = block.shape.panels();
    for pair in 0..panels / 2 {
        for tile in Tiles::new(block, MAX_RUNS) {
            dispatch::<2>(block, &tile, 2 * pair, out);
        }
    }
    if panels % 2 == 1 {
        for tile in Tiles::new(block, MAX_RUNS) {
            dispatch::<1>(block, &tile, panels - 1, out);
        }
    }
}

/// Calls the tile function of the tile's size: loops of constant length keep accumulators in registers.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
fn dispatch<const P: usize>(block: &Block<'_>, tile: &Tile, panel: usize, out: &mut Out<'_>) {
    match (tile.runs, tile.width) {
        (3, 4) => multiply::<3, 4, P>(block, tile, panel, out),
        (2, 4) => multiply::<2, 4, P>(block, tile, panel, out),
        (1, 4) => multiply::<1, 4, P>(block, tile, panel, out),
        (3, 3) => multiply::<3, 3, P>(block, tile, panel, out),
        (2, 3) => multiply::<2, 3, P>(block, tile, panel, out),
        (1, 3) => multiply::<1, 3, P>(block, tile, panel, out),
        (3, 2) => multiply::<3, 2, P>(block, tile, panel, out),
        (2, 2) => multiply::<2, 2, P>(block, tile, panel, out),
        (1, 2) => multiply::<1, 2, P>(block, tile, panel, out),
        (3, _) => multiply::<3, 1, P>(block, tile, panel, out),
        (2, _) => multiply::<2, 1, P>(block, tile, panel, out),
        _ => multiply::<1, 1, P>(block, tile, panel, out),
    }
}

/// R runs of W pixels with P panels.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
fn multiply<const R: usize, const W: usize, const P: usize>(
    block: &Block<'_>,
    tile: &Tile,
    panel: usize,
    out: &mut Out<'_>,
) {
    let (step, groups, panel_len) = (block.step, block.shape.groups(), block.shape.panel_len());
    let mut acc = [[[_mm512_set1_epi32(0); P]; W]; R];
    for p in 0..P {
        // SAFETY: `Block::new` checked one offset per packed channel.
        let offset = unsafe { _mm512_loadu_si512(block.offset.as_ptr().add((panel + p) * PANEL).cast()) };
        for run in &mut acc {
            for pixel in run {
                pixel[p] = offset;
            }
        }
    }
    let starts: [usize; R] = core::array::from_fn(|r| block.pixel_start(tile.pixels[r]));
    for row in 0..block.shape.height {
        // SAFETY: `Block::new` checked that the band reaches to the last group of the last pixel's last row
        // (`Geometry::band_len`) and that the weights are as long as their shape says; all reads lie before these ends.
        unsafe {
            let mut inputs: [*const u8; R] =
                core::array::from_fn(|r| block.band.as_ptr().add(starts[r] + row * block.pitch));
            let mut weights = block.weights.as_ptr().add(panel * panel_len + row * groups * BLOCK);
            for _ in 0..groups {
                let w: [__m512i; P] =
                    core::array::from_fn(|p| _mm512_loadu_si512(weights.add(p * panel_len).cast()));
                for r in 0..R {
                    for (i, pixel) in acc[r].iter_mut().enumerate() {
                        let four = inputs[r].add(i * step).cast::<i32>().read_unaligned();
                        let input = _mm512_set1_epi32(four);
                        for p in 0..P {
                            pixel[p] = _mm512_dpbusd_epi32(pixel[p], input, w[p]);
                        }
                    }
                    inputs[r] = inputs[r].add(GROUP);
                }
                weights = weights.add(BLOCK);
            }
        }
    }
    for (run, first) in acc.into_iter().zip(tile.pixels) {
        for (i, pixel) in run.into_iter().enumerate() {
            for (p, sums) in pixel.into_iter().enumerate() {
                store(block, first + i, panel + p, sums, out);
            }
        }
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
fn store(block: &Block<'_>, pixel: usize, panel: usize, acc: __m512i, out: &mut Out<'_>) {
    let cout = block.shape.cout;
    let lanes = (cout - panel * PANEL).min(PANEL);
    let mask = u16::MAX >> (PANEL - lanes);
    let at = pixel * cout + panel * PANEL;
    match out {
        Out::Codes(requant, out) => {
            let (low, high) = requant.range.product_bounds();
            let zero_point = i32::from(requant.range.zero_point);
            // SAFETY: `Kernels::convolve` checked that there is one multiplier per packed channel and that `out`
            // holds every pixel's `cout` codes; the mask ends at the last of them.
            unsafe {
                let multiplier = _mm512_loadu_ps(requant.multiplier.as_ptr().add(panel * PANEL));
                let product = _mm512_mul_ps(_mm512_cvtepi32_ps(acc), multiplier);
                let clamped =
                    _mm512_min_ps(_mm512_max_ps(product, _mm512_set1_ps(low)), _mm512_set1_ps(high));
                let rounded =
                    _mm512_cvt_roundps_epi32::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(clamped);
                let codes = _mm512_cvtepi32_epi8(_mm512_add_epi32(rounded, _mm512_set1_epi32(zero_point)));
                _mm_mask_storeu_epi8(out.as_mut_ptr().add(at), mask, codes);
            }
        }
        // SAFETY: `Kernels::accumulate` checked that `out` holds every pixel's `cout` accumulators.
        Out::Sums(out) => unsafe { _mm512_mask_storeu_epi32(out.as_mut_ptr().add(at), mask, acc) },
    }
}
