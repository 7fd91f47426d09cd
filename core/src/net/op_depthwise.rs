//! Depthwise convolution: every channel has a kernel of its own. See `docs/model-format.md` for the arithmetic.
//!
//! Plain loops, compiled per level, which LLVM vectorises over [`LANES`] channels. A part of the output's rows works
//! through its blocks of that many channels one after the other: a block's input rows are gathered into a band (padded
//! with the zero point, widened to 16 bits, small enough for the first cache), where a pixel's taps lie at distances
//! that the compiler knows, and no tap asks whether it is inside the image. Kernels of 3 x 3 and 5 x 5, which networks
//! have, are unrolled.
use super::band::{Bands, Input};
use super::graph::Depthwise;
use super::op_conv::fill_multipliers;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, for_each_row_block};
use crate::kernels::Kernels;
use crate::kernels::quant::Range;

/// Channels of a block.
const LANES: usize = 16;
/// Pixels that are finished before they are copied to the output: codes read back at once, in another width than they
/// were written in, would have to wait for the cache.
const RUN: usize = 16;

type Lanes = [i16; LANES];

fn taps(layer: &Depthwise<'_>) -> usize {
    let window = layer.window.get();
    window.height * window.width
}

/// Scratch that [`run`] takes, for `side x side` output pixels.
pub(super) fn scratch_bytes(layer: &Depthwise<'_>, side: usize) -> usize {
    let bands = Bands::new(&layer.window.get(), LANES, side);
    let channels = layer.channels.next_multiple_of(LANES);
    bytes_for::<i16>(bands.slots.saturating_mul(bands.len))
        .saturating_add(bytes_for::<i16>(taps(layer) * channels))
        .saturating_add(bytes_for::<i32>(channels))
        .saturating_add(bytes_for::<f32>(channels))
}

/// Runs one depthwise convolution; `output` is `side x side x channels`, interleaved.
#[inline(never)] // As op_conv::run: for profiles.
pub(super) fn run(
    layer: &Depthwise<'_>,
    input: Input<'_>,
    (scale, range): (f32, Range),
    (kernels, exec): (&Kernels, &dyn Executor),
    mut scratch: Arena<'_>,
    side: usize,
    output: &mut [i8],
) -> Result<(), Error> {
    let bands = Bands::new(&layer.window.get(), LANES, side);
    let channels = layer.channels.next_multiple_of(LANES);
    let band = scratch.take::<i16>(bands.slots.saturating_mul(bands.len))?;
    let weights = scratch.take::<i16>(taps(layer) * channels)?;
    let offset = scratch.zeroed::<i32>(channels)?;
    let multiplier = scratch.zeroed::<f32>(channels)?;
    fill_weights(layer, weights);
    fill_offsets(layer, input.zero_point, offset);
    fill_multipliers(layer.weight_scale, scale, multiplier);
    let part = Part { layer, input, bands: &bands, weights, offset, multiplier, range };
    let planes = (Plane::new(output, bands.slot_rows * side * layer.channels), Plane::new(band, bands.len));
    for_each_row_block(exec, bands.slots, 1, planes, &|slot, (mut out, mut band)| {
        let (first, out, band) = (slot.start * bands.slot_rows, out.values(), band.values());
        kernels.simd().run(
            #[inline(always)]
            || part.run(first, out, band),
        );
    });
    Ok(())
}

/// `[height][width][channels]` to `[block][height][width][LANES]`, the last block padded with zeros.
fn fill_weights(layer: &Depthwise<'_>, weights: &mut [i16]) {
    for (block, weights) in weights.chunks_exact_mut(taps(layer) * LANES).enumerate() {
        let plain = layer.weights.chunks_exact(layer.channels);
        for (lanes, plain) in weights.as_chunks_mut::<LANES>().0.iter_mut().zip(plain) {
            let plain = plain.get(block * LANES..).unwrap_or(&[]);
            *lanes = [0; LANES];
            lanes.iter_mut().zip(plain).for_each(|(slot, &weight)| *slot = i16::from(weight));
        }
    }
}

/// What accumulators start from: the bias, less what the zero point adds to every sum. The offsets come in as zeros.
fn fill_offsets(layer: &Depthwise<'_>, zero_point: i8, offset: &mut [i32]) {
    for weights in layer.weights.chunks_exact(layer.channels) {
        offset.iter_mut().zip(weights).for_each(|(sum, &weight)| *sum += i32::from(weight));
    }
    for (slot, bias) in offset.iter_mut().zip(layer.bias.iter()) {
        *slot = bias - i32::from(zero_point) * *slot;
    }
}

/// What every part of the output needs.
struct Part<'a> {
    layer: &'a Depthwise<'a>,
    input: Input<'a>,
    bands: &'a Bands,
    weights: &'a [i16],
    offset: &'a [i32],
    multiplier: &'a [f32],
    range: Range,
}

/// [`LANES`] channels, the first of them `start`.
struct Block<'a> {
    start: usize,
    /// Per tap.
    weights: &'a [Lanes],
    offset: &'a [i32; LANES],
    multiplier: &'a [f32; LANES],
    range: Range,
}

impl Part<'_> {
    /// The output rows from `first` on that `out` holds.
    #[inline(always)]
    fn run(&self, first: usize, out: &mut [i8], band: &mut [i16]) {
        let window = &self.layer.window.get();
        let (rows, row_len) = (self.bands.rows, self.bands.side * self.layer.channels);
        for (index, out) in out.chunks_mut(rows * row_len).enumerate() {
            let weights = self.weights.chunks_exact(taps(self.layer) * LANES);
            let units = self.offset.as_chunks().0.iter().zip(self.multiplier.as_chunks().0);
            for (block, (weights, (offset, multiplier))) in weights.zip(units).enumerate() {
                let (start, weights) = (block * LANES, weights.as_chunks().0);
                let block = Block { start, weights, offset, multiplier, range: self.range };
                self.fill(start, first + index * rows, band);
                match (window.height, window.width) {
                    (3, 3) => self.unrolled::<3, 3>(&block, band, out),
                    (5, 5) => self.unrolled::<5, 5>(&block, band, out),
                    _ => self.any(&block, band, out),
                }
            }
        }
    }

    /// Gathers the channels from `start` on of the input rows that the output rows from `first` on read.
    #[inline(always)]
    fn fill(&self, start: usize, first: usize, band: &mut [i16]) {
        let (window, channels, input) = (&self.layer.window.get(), self.layer.channels, &self.input);
        let ([top, left, ..], zero) = (window.pad, [i16::from(input.zero_point); LANES]);
        let row_len = input.side * channels;
        for (row, line) in band.chunks_exact_mut(self.bands.pitch).enumerate() {
            let y = (first * window.stride + row).checked_sub(top);
            // Above and below the image, no pixels: then all are padding.
            let source = y.and_then(|y| input.data.get(y * row_len..(y + 1) * row_len)).unwrap_or(&[]);
            let pixels = line.as_chunks_mut::<LANES>().0;
            let (before, rest) = pixels.split_at_mut(left.min(pixels.len()));
            let (inside, after) = rest.split_at_mut((source.len() / channels).min(rest.len()));
            before.fill(zero);
            after.fill(zero);
            for (lanes, pixel) in inside.iter_mut().zip(source.chunks_exact(channels)) {
                let codes = pixel.get(start..).unwrap_or(&[]);
                if let Some(codes) = codes.first_chunk::<LANES>() {
                    *lanes = codes.map(i16::from);
                } else {
                    *lanes = zero;
                    lanes.iter_mut().zip(codes).for_each(|(slot, &code)| *slot = i16::from(code));
                }
            }
        }
    }

    /// Row `row` of a band.
    #[inline(always)]
    fn line<'b>(&self, band: &'b [i16], row: usize) -> &'b [Lanes] {
        let pitch = self.bands.pitch;
        band.get(row * pitch..(row + 1) * pitch).unwrap_or(&[]).as_chunks().0
    }

    /// A block of a kernel whose extent the compiler knows.
    #[inline(always)]
    fn unrolled<const H: usize, const W: usize>(&self, block: &Block<'_>, band: &[i16], out: &mut [i8]) {
        let Some(weights) = block.weights.as_chunks::<W>().0.first_chunk::<H>() else { return };
        let stride = self.layer.window.get().stride;
        for (y, out) in out.chunks_exact_mut(self.bands.side * self.layer.channels).enumerate() {
            let lines: [_; H] = core::array::from_fn(|row| self.line(band, y * stride + row));
            self.row(
                block.start,
                out,
                #[inline(always)]
                |x, codes| {
                    let none = &[[0; LANES]; W];
                    let taps = lines.map(|line| {
                        line.get(x * stride..).and_then(|line| line.first_chunk()).unwrap_or(none)
                    });
                    block.pixel(taps, weights, codes);
                },
            );
        }
    }

    /// A block of any kernel.
    #[inline(always)]
    fn any(&self, block: &Block<'_>, band: &[i16], out: &mut [i8]) {
        let window = &self.layer.window.get();
        for (y, out) in out.chunks_exact_mut(self.bands.side * self.layer.channels).enumerate() {
            self.row(
                block.start,
                out,
                #[inline(always)]
                |x, codes| {
                    let mut acc = *block.offset;
                    for (row, weights) in block.weights.chunks_exact(window.width).enumerate() {
                        let line = self.line(band, y * window.stride + row);
                        let taps = line.get(x * window.stride..).unwrap_or(&[]);
                        for (taps, weights) in taps.iter().zip(weights) {
                            for ((acc, &q), &weight) in acc.iter_mut().zip(taps).zip(weights) {
                                *acc = acc.wrapping_add(i32::from(q.wrapping_mul(weight)));
                            }
                        }
                    }
                    for ((code, &acc), &multiplier) in codes.iter_mut().zip(&acc).zip(block.multiplier) {
                        *code = block.range.requantise_lane(acc, multiplier);
                    }
                },
            );
        }
    }

    /// One output row's channels from `start` on: `pixel` makes the codes of each pixel by number.
    #[inline(always)]
    fn row(&self, start: usize, out: &mut [i8], pixel: impl Fn(usize, &mut [i8; LANES])) {
        let channels = self.layer.channels;
        let mut done = [[0; LANES]; RUN];
        for (run, out) in out.chunks_mut(RUN * channels).enumerate() {
            let count = out.len() / channels;
            for (x, codes) in done.iter_mut().enumerate().take(count) {
                pixel(run * RUN + x, codes);
            }
            for (out, codes) in out.chunks_exact_mut(channels).zip(&done) {
                let out = out.get_mut(start..).unwrap_or(&mut []);
                if let Some(out) = out.first_chunk_mut() {
                    *out = *codes;
                } else {
                    out.iter_mut().zip(codes).for_each(|(out, &code)| *out = code);
                }
            }
        }
    }
}

impl Block<'_> {
    /// One pixel's codes. `taps`: its input pixels, by kernel row and column.
    ///
    /// Products are added in pairs before they are widened: weights are within [-127, 127] (`load_layers.rs` refuses
    /// -128), codes within [-128, 127], so that two are at most 32512. Sums of 32 bits fit (`MAX_PRODUCTS`). So nothing
    /// wraps; the wrapping operations are for builds that check overflow, where others would not vectorise.
    #[inline(always)]
    fn pixel<const H: usize, const W: usize>(
        &self,
        taps: [&[Lanes; W]; H],
        weights: &[[Lanes; W]; H],
        codes: &mut [i8; LANES],
    ) {
        for i in 0..LANES {
            let (mut acc, mut odd) = (self.offset[i], None);
            for row in 0..H {
                for column in 0..W {
                    let product = taps[row][column][i].wrapping_mul(weights[row][column][i]);
                    odd = match odd {
                        None => Some(product),
                        Some(other) => {
                            acc = acc.wrapping_add(i32::from(product.wrapping_add(other)));
                            None
                        }
                    };
                }
            }
            acc = acc.wrapping_add(i32::from(odd.unwrap_or(0)));
            codes[i] = self.range.requantise_lane(acc, self.multiplier[i]);
        }
    }
}
