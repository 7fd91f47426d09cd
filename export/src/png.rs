//! PNG pictures (ISO 15948): grey or RGB, 8 or 16 bits a channel, not interlaced, one IDAT chunk.
//!
//! Rows are filtered by the usual rule, the filter whose bytes are smallest in sum, and deflated at zlib's level 6. The
//! bytes are the same on every platform.
use crate::Error;
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use flashmat_core::maps::Quantum;
use flashmat_core::net::format::crc32;
use miniz_oxide::DataFormat;
use miniz_oxide::deflate::CompressionLevel;
use miniz_oxide::deflate::core::{CompressorOxide, TDEFLFlush, compress_to_output};

/// Channels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// One.
    Grey,
    /// Three, interleaved.
    Rgb,
}

impl Colour {
    /// Values per pixel.
    #[must_use]
    pub const fn channels(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Rgb => 3,
        }
    }
}

/// A channel's type: `u8` or `u16`.
pub trait Channel: Quantum + bytemuck::Pod {
    /// Appends a row as PNG has it: big-endian.
    #[doc(hidden)]
    fn append(row: &[Self], out: &mut [u8]);
}

impl Channel for u8 {
    fn append(row: &[Self], out: &mut [u8]) {
        out.iter_mut().zip(row).for_each(|(to, &from)| *to = from);
    }
}

impl Channel for u16 {
    fn append(row: &[Self], out: &mut [u8]) {
        for (to, from) in out.as_chunks_mut::<2>().0.iter_mut().zip(row) {
            *to = from.to_be_bytes();
        }
    }
}

const SIGNATURE: [u8; 8] = [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n'];
/// A chunk's data has at most 2³¹ - 1 bytes.
const MAX_CHUNK: usize = i32::MAX as usize;

/// A file of `width` x `height` pixels: `row(y, codes)` fills the rows from the top, each `width` pixels of interleaved
/// channels, zeros at first.
///
/// # Errors
/// [`Error::Size`] for no pixels and too many; those of `row`.
pub fn file<T: Channel>(
    (width, height): (usize, usize),
    colour: Colour,
    mut row: impl FnMut(usize, &mut [T]) -> Result<(), Error>,
) -> Result<Vec<u8>, Error> {
    let side =
        |n: usize| u32::try_from(n).ok().filter(|n| (1..=MAX_CHUNK as u32).contains(n)).ok_or(Error::Size);
    let (across, down) = (side(width)?, side(height)?);
    let values = width.checked_mul(colour.channels()).ok_or(Error::Size)?;
    let bytes = values.checked_mul(size_of::<T>()).filter(|&n| n < MAX_CHUNK).ok_or(Error::Size)?;
    let mut file = Vec::from(SIGNATURE);
    let mut header = [across.to_be_bytes(), down.to_be_bytes()].concat();
    // Bits, colour type, deflate, adaptive filters, not interlaced.
    header.extend([8 * size_of::<T>() as u8, if colour == Colour::Rgb { 2 } else { 0 }, 0, 0, 0]);
    chunk(&mut file, *b"IHDR", |out| {
        out.extend_from_slice(&header);
        Ok(())
    })?;
    chunk(&mut file, *b"IDAT", |out| {
        let mut lines = Lines::new(bytes, colour.channels() * size_of::<T>());
        let mut deflate = Box::new(CompressorOxide::with_format_and_level(
            DataFormat::Zlib,
            CompressionLevel::DefaultLevel,
        ));
        let mut codes = vec![T::zeroed(); values];
        for y in 0..height {
            codes.fill(T::zeroed());
            row(y, &mut codes)?;
            T::append(&codes, lines.next());
            let line = lines.filtered();
            let flush = if y + 1 == height { TDEFLFlush::Finish } else { TDEFLFlush::None };
            // It takes all of the input, and its status is only ever that of the callback.
            compress_to_output(&mut deflate, line, flush, |part| {
                out.extend_from_slice(part);
                true
            });
        }
        Ok(())
    })?;
    chunk(&mut file, *b"IEND", |_| Ok(()))?;
    Ok(file)
}

/// Appends a chunk whose data `data` appends.
fn chunk(
    file: &mut Vec<u8>,
    kind: [u8; 4],
    data: impl FnOnce(&mut Vec<u8>) -> Result<(), Error>,
) -> Result<(), Error> {
    let start = file.len();
    file.extend([0; 4]);
    file.extend(kind);
    data(file)?;
    let length = file.len() - start - 8;
    let length = u32::try_from(length).ok().filter(|&n| n <= MAX_CHUNK as u32).ok_or(Error::Size)?;
    if let Some(place) = file.get_mut(start..start + 4) {
        place.copy_from_slice(&length.to_be_bytes());
    }
    let crc = crc32(file.get(start + 4..).unwrap_or(&[]));
    file.extend(crc.to_be_bytes());
    Ok(())
}

/// A filter of a row and the one above; both begin with a margin of as many zeros as a pixel has bytes.
type Filter = fn(row: &[u8], above: &[u8], step: usize, out: &mut [u8]);

/// The filters, by their number in the file.
const FILTERS: [Filter; 5] = [none, sub, up, average, paeth];

/// Two rows of bytes, and the newer one as every filter makes it.
struct Lines {
    /// Bytes from a pixel to the next.
    step: usize,
    /// Rows behind a margin of one pixel of zeros on the left, which is what the filters see beyond the border.
    above: Vec<u8>,
    row: Vec<u8>,
    best: Vec<u8>,
    other: Vec<u8>,
}

impl Lines {
    fn new(bytes: usize, step: usize) -> Self {
        let row = vec![0; step + bytes];
        let filtered = vec![0; 1 + bytes];
        Self { step, above: row.clone(), row, best: filtered.clone(), other: filtered }
    }

    /// Goes on to the next row; where its bytes go.
    fn next(&mut self) -> &mut [u8] {
        core::mem::swap(&mut self.above, &mut self.row);
        self.row.get_mut(self.step..).unwrap_or(&mut [])
    }

    /// The row behind the number of the filter whose bytes, as signed numbers, are smallest in sum.
    fn filtered(&mut self) -> &[u8] {
        let mut smallest = u64::MAX;
        for (number, filter) in (0..).zip(FILTERS) {
            let Some((head, bytes)) = self.other.split_first_mut() else { continue };
            *head = number;
            filter(&self.row, &self.above, self.step, bytes);
            let sum = bytes.iter().map(|&byte| u64::from(byte.cast_signed().unsigned_abs())).sum();
            if sum < smallest {
                smallest = sum;
                core::mem::swap(&mut self.best, &mut self.other);
            }
        }
        &self.best
    }
}

/// `out[i] = f(row, left, above, above left)`; `row` and `above` begin with a margin of one pixel.
fn each(row: &[u8], above: &[u8], step: usize, out: &mut [u8], f: impl Fn(u8, u8, u8, u8) -> u8) {
    let (here, over) = (row.get(step..).unwrap_or(&[]), above.get(step..).unwrap_or(&[]));
    let values = here.iter().zip(row).zip(over.iter().zip(above));
    for (out, ((&value, &left), (&up, &corner))) in out.iter_mut().zip(values) {
        *out = f(value, left, up, corner);
    }
}

fn none(row: &[u8], above: &[u8], step: usize, out: &mut [u8]) {
    each(row, above, step, out, |value, _, _, _| value);
}

fn sub(row: &[u8], above: &[u8], step: usize, out: &mut [u8]) {
    each(row, above, step, out, |value, left, _, _| value.wrapping_sub(left));
}

fn up(row: &[u8], above: &[u8], step: usize, out: &mut [u8]) {
    each(row, above, step, out, |value, _, up, _| value.wrapping_sub(up));
}

fn average(row: &[u8], above: &[u8], step: usize, out: &mut [u8]) {
    each(row, above, step, out, |value, left, up, _| value.wrapping_sub(left.midpoint(up)));
}

/// The neighbour that is nearest to left + up - corner; in doubt left, then up.
fn paeth(row: &[u8], above: &[u8], step: usize, out: &mut [u8]) {
    each(row, above, step, out, |value, left, up, corner| {
        let [a, b, c] = [left, up, corner].map(i16::from);
        let (to_left, to_up, to_corner) = ((b - c).abs(), (a - c).abs(), (a + b - 2 * c).abs());
        let nearest = if to_left <= to_up && to_left <= to_corner {
            left
        } else if to_up <= to_corner {
            up
        } else {
            corner
        };
        value.wrapping_sub(nearest)
    });
}
