//! Bands: the input rows that a few output rows need, up-sampled, concatenated and padded, so that every kernel row
//! of every output pixel is one contiguous run. A band is all that is ever gathered; whole images never are.
//!
//! An image's output rows are cut into at most [`SLOTS`] equal parts for the executor; each part works through its
//! bands one after the other in its own piece of scratch memory. Cuts depend on shapes alone, never on threads.
use super::graph::Window;
use crate::kernels::{Geometry, Kernels, pack};

/// Most parts that can run at once.
const SLOTS: usize = 8;
/// Most output rows in a band; more rows gather fewer input rows twice.
const MAX_ROWS: usize = 8;
/// Bands of more than [`MIN_ROWS`] rows stay below this many codes, to lie in a second-level cache.
const TARGET_CODES: usize = 96 << 10;
const MIN_ROWS: usize = 2;

/// An int8 image as a convolution reads it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Input<'a> {
    /// Interleaved codes, `side x side x channels`.
    pub(crate) data: &'a [i8],
    /// Pixels per side, before up-sampling.
    pub(crate) side: usize,
    /// Channels.
    pub(crate) channels: usize,
    /// Every pixel is read twice in both directions.
    pub(crate) upsample: bool,
    /// Code of real zero, which padding gets.
    pub(crate) zero_point: i8,
}

/// How a convolution's output is cut into bands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bands {
    /// Output rows, and pixels in each.
    pub(crate) side: usize,
    /// Output rows in a band (the last of a part may have fewer).
    pub(crate) rows: usize,
    /// Parts for the executor.
    pub(crate) slots: usize,
    /// Output rows in a part (the last may have fewer).
    pub(crate) slot_rows: usize,
    /// Codes between input rows of a band.
    pub(crate) pitch: usize,
    /// Codes of a whole band.
    pub(crate) len: usize,
    window: Window,
    cin: usize,
}

impl Bands {
    /// Bands of a convolution with `side x side` output pixels that reads `cin` channels.
    pub(crate) fn new(window: &Window, cin: usize, side: usize) -> Self {
        let [_, left, _, right] = window.pad;
        let columns = side.saturating_mul(window.stride).saturating_add(left + right);
        let run = pack::Shape::new(1, window.height, window.width, cin).groups() * pack::GROUP;
        // The last pixel's last group may reach past the row: keep zeros there.
        let pitch = columns.saturating_mul(cin).saturating_add(run - window.width * cin).next_multiple_of(64);
        let input_rows = |rows: usize| (rows - 1) * window.stride + window.height;
        let fits = |rows: &usize| input_rows(*rows).saturating_mul(pitch) <= TARGET_CODES;
        let most = MAX_ROWS.min(side.max(1));
        let rows = (MIN_ROWS.min(most)..=most).rev().find(fits).unwrap_or(MIN_ROWS.min(most));
        let bands = side.div_ceil(rows);
        let slots = bands.clamp(1, SLOTS);
        let slot_rows = bands.div_ceil(slots) * rows;
        let slots = side.div_ceil(slot_rows).max(1);
        let len = input_rows(rows).saturating_mul(pitch);
        Self { side, rows, slots, slot_rows, pitch, len, window: *window, cin }
    }

    /// Bytes of a whole band.
    pub(crate) fn bytes(&self, kernels: &Kernels) -> usize {
        self.len.saturating_mul(kernels.code_bytes())
    }

    /// Where `rows` output rows lie in a band.
    pub(crate) fn geometry(&self, rows: usize, kernels: &Kernels) -> Geometry {
        let code = kernels.code_bytes();
        let pitch = self.pitch.saturating_mul(code);
        Geometry {
            code,
            pitch,
            step: self.window.stride * self.cin * code,
            row_step: self.window.stride * pitch,
            rows,
            cols: self.side,
        }
    }

    /// Fills a band for `rows` output rows from `first`, in the codes of `kernels`.
    pub(crate) fn fill<'a>(
        &self,
        inputs: impl Iterator<Item = Input<'a>> + Clone,
        first: usize,
        rows: usize,
        kernels: &Kernels,
        band: &mut [u8],
    ) {
        let (bands, flip) = (self, kernels.flip());
        if kernels.code_bytes() == 1 {
            let fill = Fill { bands, inputs, first, rows, flip, band };
            kernels.simd().run(
                #[inline(always)]
                || fill.run(),
            );
        } else if let Ok(band) = bytemuck::try_cast_slice_mut::<u8, i16>(band) {
            let fill = Fill { bands, inputs, first, rows, flip, band };
            kernels.simd().run(
                #[inline(always)]
                || fill.run(),
            );
        }
    }
}

/// A code as it lies in a band.
trait Code: Copy + Default {
    fn of(code: i8, flip: u8) -> Self;
}

impl Code for u8 {
    #[inline(always)]
    fn of(code: i8, flip: u8) -> Self {
        code.cast_unsigned() ^ flip
    }
}

impl Code for i16 {
    #[inline(always)]
    fn of(code: i8, _flip: u8) -> Self {
        Self::from(code)
    }
}

/// Gathers one band; codes of one byte are stored xor `flip`.
struct Fill<'b, I, C> {
    bands: &'b Bands,
    inputs: I,
    first: usize,
    rows: usize,
    flip: u8,
    band: &'b mut [C],
}

impl<'a, I: Iterator<Item = Input<'a>> + Clone, C: Code> Fill<'_, I, C> {
    #[inline(always)]
    fn run(self) {
        let window = &self.bands.window;
        let input_rows = self.rows.saturating_sub(1) * window.stride + window.height;
        let [top, ..] = window.pad;
        for (row, line) in self.band.chunks_exact_mut(self.bands.pitch).take(input_rows).enumerate() {
            let from = (self.first * window.stride + row).checked_sub(top);
            self.bands.fill_row(self.inputs.clone(), from, self.flip, line);
        }
    }
}

impl Bands {
    /// One padded row; `from` is the input row, or `None` above the image.
    #[inline(always)]
    fn fill_row<'a, C: Code>(
        &self,
        inputs: impl Iterator<Item = Input<'a>>,
        from: Option<usize>,
        flip: u8,
        line: &mut [C],
    ) {
        let [_, left, _, right] = self.window.pad;
        let width = self.side * self.window.stride;
        let (line, slack) = line.split_at_mut(((left + width + right) * self.cin).min(line.len()));
        slack.fill(C::default());
        let mut channel = 0;
        for input in inputs {
            let zero = C::of(input.zero_point, flip);
            let y = from.map(|y| if input.upsample { y / 2 } else { y });
            let row_len = input.side * input.channels;
            let source = y.and_then(|y| input.data.get(y * row_len..(y + 1) * row_len));
            let Some(source) = source else {
                pixels(line, self.cin, channel, input.channels).for_each(|pixel| pixel.fill(zero));
                channel += input.channels;
                continue;
            };
            let (before, rest) = line.split_at_mut((left * self.cin).min(line.len()));
            let (inside, after) = rest.split_at_mut((width * self.cin).min(rest.len()));
            for pad in [before, after] {
                pixels(pad, self.cin, channel, input.channels).for_each(|pixel| pixel.fill(zero));
            }
            if input.channels == self.cin && !input.upsample {
                copy_flipped(source, flip, inside);
            } else if input.upsample {
                let pairs = inside.chunks_exact_mut(2 * self.cin);
                for (codes, pair) in source.chunks_exact(input.channels).zip(pairs) {
                    let (first, second) = pair.split_at_mut(self.cin);
                    for pixel in [first, second] {
                        let slots = pixel.get_mut(channel..channel + input.channels).unwrap_or(&mut []);
                        copy_flipped(codes, flip, slots);
                    }
                }
            } else {
                let pixels = pixels(inside, self.cin, channel, input.channels);
                for (codes, pixel) in source.chunks_exact(input.channels).zip(pixels) {
                    copy_flipped(codes, flip, pixel);
                }
            }
            channel += input.channels;
        }
    }
}

/// The `count` channels from `channel` of every pixel of a line.
#[inline(always)]
fn pixels<C>(line: &mut [C], cin: usize, channel: usize, count: usize) -> impl Iterator<Item = &mut [C]> {
    line.chunks_exact_mut(cin).map(move |pixel| pixel.get_mut(channel..channel + count).unwrap_or(&mut []))
}

/// Copies codes xor `flip` in the widest steps that fit, the last one over codes already copied: channel counts are too
/// small for a call of `memcpy`. The slices are of one length.
#[inline(always)]
fn copy_flipped<C: Code>(codes: &[i8], flip: u8, out: &mut [C]) {
    if codes.len() >= 64 {
        copy_by::<64, C>(codes, flip, out);
    } else if codes.len() >= 32 {
        copy_by::<32, C>(codes, flip, out);
    } else if codes.len() >= 16 {
        copy_by::<16, C>(codes, flip, out);
    } else if codes.len() >= 8 {
        copy_by::<8, C>(codes, flip, out);
    } else {
        copy_by::<1, C>(codes, flip, out);
    }
}

#[inline(always)]
fn copy_by<const N: usize, C: Code>(codes: &[i8], flip: u8, out: &mut [C]) {
    for (out, codes) in out.as_chunks_mut::<N>().0.iter_mut().zip(codes.as_chunks::<N>().0) {
        copy_chunk(codes, flip, out);
    }
    if let (Some(out), Some(codes)) = (out.last_chunk_mut::<N>(), codes.last_chunk::<N>()) {
        copy_chunk(codes, flip, out);
    }
}

/// By way of a copy: loads all come before stores, which the compiler needs to know to make one vector of each.
#[inline(always)]
fn copy_chunk<const N: usize, C: Code>(codes: &[i8; N], flip: u8, out: &mut [C; N]) {
    let mut chunk = [C::default(); N];
    for (slot, &q) in chunk.iter_mut().zip(codes) {
        *slot = C::of(q, flip);
    }
    *out = chunk;
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn a_band_holds_what_the_window_reads() {
        let first: Vec<i8> = (0..3 * 3 * 4).map(|i| i as i8).collect();
        let second: Vec<i8> = (0..6 * 6 * 3).map(|i| 60 - i as i8).collect();
        let inputs = [
            Input { data: &first, side: 3, channels: 4, upsample: true, zero_point: -7 },
            Input { data: &second, side: 6, channels: 3, upsample: false, zero_point: 9 },
        ];
        let window = Window { height: 3, width: 3, stride: 1, pad: [1, 1, 1, 1] };
        let bands = Bands::new(&window, 7, 6);
        for kernels in Kernels::supported() {
            let (flip, size) = (kernels.flip(), kernels.code_bytes());
            for start in 0..6 {
                let rows = bands.rows.min(6 - start);
                let mut words = vec![0xEEEE_u16; bands.bytes(kernels).div_ceil(2)];
                let band: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
                bands.fill(inputs.iter().copied(), start, rows, kernels, band);
                let at = |index: usize| match size {
                    1 => i16::from((band[index] ^ flip).cast_signed()),
                    _ => i16::from_ne_bytes([band[2 * index], band[2 * index + 1]]),
                };
                for row in 0..rows + 2 {
                    for column in 0..8_usize {
                        for c in 0..7 {
                            let (y, x) = ((start + row).wrapping_sub(1), column.wrapping_sub(1));
                            let want = match (y < 6 && x < 6, c < 4) {
                                (false, true) => -7,
                                (false, false) => 9,
                                (true, true) => first[((y / 2) * 3 + x / 2) * 4 + c],
                                (true, false) => second[(y * 6 + x) * 3 + c - 4],
                            };
                            assert_eq!(at(row * bands.pitch + column * 7 + c), i16::from(want));
                        }
                    }
                    let slack = &band[(row * bands.pitch + 8 * 7) * size..(row + 1) * bands.pitch * size];
                    assert!(slack.iter().all(|&b| b == 0));
                }
            }
        }
    }

    #[test]
    fn parts_cover_all_rows() {
        for side in [1, 2, 3, 7, 8, 16, 31, 64, 100, 128, 512, 1024] {
            for cin in [5, 32, 72, 512] {
                let window = Window { height: 3, width: 3, stride: 1, pad: [1, 1, 1, 1] };
                let bands = Bands::new(&window, cin, side);
                assert!(
                    bands.slots <= SLOTS && bands.rows >= 1 && bands.slot_rows.is_multiple_of(bands.rows)
                );
                assert!(bands.slots * bands.slot_rows >= side && (bands.slots - 1) * bands.slot_rows < side);
            }
        }
    }
}
