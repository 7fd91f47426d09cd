//! The caller's pixels, format by format: checks at the door, then sums of linear light along a row, as integers.
use super::exposure::{CLIPPED_BYTE, CLIPPED_WIDE, swap_red_and_blue};
use super::resample::{self, Row, Source, Sums, fixed};
use super::transfer::{WIDE_TABLE, byte_table, fill_wide_table, p3_to_srgb, srgb_to_linear, wide_lookup};
use super::yuv::{Converter, LOWEST, STEPS, YuvMatrix, YuvPlanes, step};
use super::{Encoding, MAX_SIDE, yuv};
use crate::Error;
use crate::base::arena::Arena;
use crate::base::exec::Executor;
use crate::base::simd::{Simd, prefetch};
use crate::kernels::{AHEAD, ByteTable};
use core::ops::Range;

/// Layout of a frame's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFormat {
    /// Packed 8-bit R, G, B.
    Rgb8,
    /// Packed 8-bit R, G, B, A.
    Rgba8,
    /// Packed 8-bit B, G, R, A.
    Bgra8,
    /// Packed 16-bit R, G, B.
    Rgb16,
    /// Packed f32 R, G, B.
    RgbF32,
    /// YUV 4:2:0, interleaved U, V.
    Nv12,
    /// YUV 4:2:0, interleaved V, U.
    Nv21,
    /// YUV 4:2:0, three planes.
    Yuv420,
}

/// Borrowed pixels whose buffers hold every pixel.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pixels<'a> {
    Bytes { format: PixelFormat, data: &'a [u8], stride: usize },
    Wide { data: &'a [u16], stride: usize },
    Float { data: &'a [f32], stride: usize },
    Yuv { format: PixelFormat, planes: YuvPlanes<'a>, matrix: YuvMatrix, range: yuv::Range },
}

/// Checks that `rows` rows of `row` values, `stride` apart, fit in `len` values.
pub(super) fn check_buffer(len: usize, row: usize, rows: usize, stride: usize) -> Result<(), Error> {
    if stride < row {
        return Err(Error::FrameStride { needed: row, given: stride });
    }
    let needed =
        (rows - 1).checked_mul(stride).and_then(|n| n.checked_add(row)).ok_or(Error::FrameTooLarge)?;
    if len < needed { Err(Error::FrameBuffer { needed, given: len }) } else { Ok(()) }
}

fn check_sides(width: usize, height: usize) -> Result<(), Error> {
    if width == 0 || height == 0 {
        return Err(Error::FrameEmpty);
    }
    if width > MAX_SIDE || height > MAX_SIDE { Err(Error::FrameTooLarge) } else { Ok(()) }
}

impl<'a> Pixels<'a> {
    pub(super) fn bytes(
        format: PixelFormat,
        data: &'a [u8],
        width: usize,
        height: usize,
        stride: usize,
    ) -> Result<Self, Error> {
        check_sides(width, height)?;
        let step = if format == PixelFormat::Rgb8 { 3 } else { 4 };
        check_buffer(data.len(), width * step, height, stride)?;
        Ok(Self::Bytes { format, data, stride })
    }

    pub(super) fn wide(data: &'a [u16], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        check_sides(width, height)?;
        check_buffer(data.len(), width * 3, height, stride)?;
        Ok(Self::Wide { data, stride })
    }

    pub(super) fn float(data: &'a [f32], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        check_sides(width, height)?;
        check_buffer(data.len(), width * 3, height, stride)?;
        for (y, row) in data.chunks(stride).take(height).enumerate() {
            // NaN is in no range. The whole row first, without a branch; where in it, only when there is one.
            let row = row.get(..width * 3).unwrap_or(row);
            let bad = |v: &f32| !(0.0..=f32::MAX).contains(v);
            if row.iter().fold(false, |any, v| any | bad(v)) {
                return Err(Error::FramePixel { x: row.iter().position(bad).unwrap_or(0) / 3, y });
            }
        }
        Ok(Self::Float { data, stride })
    }

    pub(super) fn yuv(
        format: PixelFormat,
        planes: YuvPlanes<'a>,
        width: usize,
        height: usize,
    ) -> Result<Self, Error> {
        check_sides(width, height)?;
        planes.check(width, height)?;
        Ok(Self::Yuv { format, planes, matrix: YuvMatrix::default(), range: yuv::Range::default() })
    }

    pub(super) fn yuv_colour(self, matrix: YuvMatrix, range: yuv::Range) -> Self {
        match self {
            Self::Yuv { format, planes, .. } => Self::Yuv { format, planes, matrix, range },
            other => other,
        }
    }

    pub(super) fn format(&self) -> PixelFormat {
        match *self {
            Self::Bytes { format, .. } | Self::Yuv { format, .. } => format,
            Self::Wide { .. } => PixelFormat::Rgb16,
            Self::Float { .. } => PixelFormat::RgbF32,
        }
    }

    /// Fills `rgb` (3 planes) and `clipped` (1 plane of marks), not yet turned upright; gives the share of the photo's pixels
    /// that are clipped in each channel.
    pub(super) fn resample(
        &self,
        window: &resample::Window,
        encoding: Encoding,
        exec: &dyn Executor,
        rgb: &mut [f32],
        clipped: &mut [u8],
        arena: &mut Arena<'_>,
    ) -> Result<[f32; 3], Error> {
        let mut shares: [f32; 3];
        let curve: fn(f32) -> f32 = if encoding == Encoding::Linear { |x| x } else { srgb_to_linear };
        match *self {
            Self::Bytes { format, data, stride } => {
                let table = &fixed_table(curve);
                let bytes = &ByteTable::new(table, CLIPPED_BYTE);
                if format == PixelFormat::Rgb8 {
                    let source = Bytes::<3> { data, stride, table, bytes };
                    shares = resample::run(&source, window, exec, rgb, clipped, arena)?;
                } else {
                    let source = Bytes::<4> { data, stride, table, bytes };
                    shares = resample::run(&source, window, exec, rgb, clipped, arena)?;
                }
                if format == PixelFormat::Bgra8 {
                    let plane = rgb.len() / 3;
                    let (first, rest) = rgb.split_at_mut(plane);
                    first.swap_with_slice(rest.split_at_mut(plane).1);
                    swap_red_and_blue(clipped);
                    shares.reverse();
                }
            }
            Self::Wide { data, stride } => {
                let mut arena = arena.scope();
                let table = arena.take::<f32>(WIDE_TABLE)?;
                fill_wide_table(table, curve);
                shares =
                    resample::run(&Wide { data, stride, table }, window, exec, rgb, clipped, &mut arena)?;
            }
            // The identity by itself: a call for every value of a large photo would cost more than the sums.
            Self::Float { data, stride } if encoding == Encoding::Linear => {
                let source = Float { data, stride, curve: |x| x };
                shares = resample::run(&source, window, exec, rgb, clipped, arena)?;
            }
            Self::Float { data, stride } => {
                let source = Float { data, stride, curve: srgb_to_linear };
                shares = resample::run(&source, window, exec, rgb, clipped, arena)?;
            }
            Self::Yuv { planes, matrix, range, .. } => {
                let table = &steps_table(&fixed_table(curve));
                let source = Yuv { planes, converter: Converter::new(matrix, range), table };
                shares = resample::run(&source, window, exec, rgb, clipped, arena)?;
            }
        }
        if encoding == Encoding::DisplayP3 {
            let (r, gb) = rgb.split_at_mut(rgb.len() / 3);
            let (g, b) = gb.split_at_mut(r.len());
            for ((r, g), b) in r.iter_mut().zip(g).zip(b) {
                [*r, *g, *b] = p3_to_srgb([*r, *g, *b]).map(|v| v.clamp(0.0, 1.0));
            }
        }
        Ok(shares)
    }
}

/// [`fixed`] of every 8-bit code.
fn fixed_table(curve: fn(f32) -> f32) -> [u64; 256] {
    let mut table = [0; 256];
    for ((code, slot), linear) in (0..=255).zip(&mut table).zip(byte_table(curve)) {
        *slot = fixed(linear, code >= CLIPPED_BYTE);
    }
    table
}

/// The values of row `y` of rows that are `stride` values apart, and all that come after it.
fn from_row<T>(data: &[T], stride: usize, y: usize) -> &[T] {
    data.get(y * stride..).unwrap_or(&[])
}

/// Pixels `start..end` of a row; none if they reach outside.
#[inline(always)]
fn span<T>(row: &[T], start: usize, end: usize) -> &[T] {
    row.get(start..end).unwrap_or(&[])
}

struct Bytes<'a, const STEP: usize> {
    data: &'a [u8],
    stride: usize,
    table: &'a [u64; 256],
    /// The same, for registers.
    bytes: &'a ByteTable,
}

struct BytesRow<'a, const STEP: usize> {
    pixels: &'a [[u8; STEP]],
    table: &'a [u64; 256],
}

impl<const STEP: usize> Source for Bytes<'_, STEP> {
    type Row<'r>
        = BytesRow<'r, STEP>
    where
        Self: 'r;

    const VALUES: usize = STEP;

    fn row(&self, y: usize) -> BytesRow<'_, STEP> {
        BytesRow { pixels: from_row(self.data, self.stride, y).as_chunks().0, table: self.table }
    }

    fn has_columns(&self, simd: Simd) -> bool {
        simd.has_byte_tables()
    }

    fn add_up_columns(&self, rows: Range<usize>, start: usize, sums: &mut [u64], simd: Simd) {
        let data = from_row(self.data, self.stride, rows.start).get(STEP * start..).unwrap_or(&[]);
        if !self.bytes.column_sums(data, (rows.len(), self.stride), sums, simd) {
            sums.fill(0);
        }
    }

    fn prefetch(&self, rows: Range<usize>, start: usize) {
        for y in rows {
            let row = from_row(self.data, self.stride, y);
            prefetch(row.get(STEP * start..STEP * start + AHEAD).unwrap_or(&[]));
        }
    }
}

impl<const STEP: usize> Row for BytesRow<'_, STEP> {
    #[inline(always)]
    fn add(&self, start: usize, end: usize, mut sums: Sums) -> Sums {
        for pixel in span(self.pixels, start, end) {
            for (sum, &code) in sums.iter_mut().zip(pixel) {
                *sum += self.table[usize::from(code)];
            }
        }
        sums
    }
}

struct Wide<'a> {
    data: &'a [u16],
    stride: usize,
    table: &'a [f32],
}

struct WideRow<'a> {
    pixels: &'a [[u16; 3]],
    table: &'a [f32],
}

impl Source for Wide<'_> {
    type Row<'r>
        = WideRow<'r>
    where
        Self: 'r;

    fn row(&self, y: usize) -> WideRow<'_> {
        WideRow { pixels: from_row(self.data, self.stride, y).as_chunks().0, table: self.table }
    }
}

impl Row for WideRow<'_> {
    #[inline(always)]
    fn add(&self, start: usize, end: usize, mut sums: Sums) -> Sums {
        for pixel in span(self.pixels, start, end) {
            for (sum, &code) in sums.iter_mut().zip(pixel) {
                *sum += fixed(wide_lookup(self.table, code).min(1.0), code >= CLIPPED_WIDE);
            }
        }
        sums
    }
}

struct Float<'a, C> {
    data: &'a [f32],
    stride: usize,
    curve: C,
}

struct FloatRow<'a, C> {
    pixels: &'a [[f32; 3]],
    curve: &'a C,
}

impl<C: Fn(f32) -> f32 + Sync> Source for Float<'_, C> {
    type Row<'r>
        = FloatRow<'r, C>
    where
        Self: 'r;

    fn row(&self, y: usize) -> FloatRow<'_, C> {
        FloatRow { pixels: from_row(self.data, self.stride, y).as_chunks().0, curve: &self.curve }
    }
}

impl<C: Fn(f32) -> f32> Row for FloatRow<'_, C> {
    #[inline(always)]
    fn add(&self, start: usize, end: usize, mut sums: Sums) -> Sums {
        for pixel in span(self.pixels, start, end) {
            for (sum, &value) in sums.iter_mut().zip(pixel) {
                *sum += fixed((self.curve)(value.min(1.0)), value >= 1.0);
            }
        }
        sums
    }
}

/// [`fixed`] of every [`step`]: the clamp to 8-bit codes is in the table.
fn steps_table(codes: &[u64; 256]) -> [u64; STEPS] {
    let mut table = [0; STEPS];
    for (value, slot) in (LOWEST..).zip(&mut table) {
        *slot = codes[usize::from(value.clamp(0, 255) as u8)];
    }
    table
}

struct Yuv<'a> {
    planes: YuvPlanes<'a>,
    converter: Converter,
    table: &'a [u64; STEPS],
}

struct YuvRow<'a> {
    luma: &'a [u8],
    u: &'a [u8],
    v: &'a [u8],
    source: &'a Yuv<'a>,
}

impl<'a> Source for Yuv<'a> {
    type Row<'r>
        = YuvRow<'r>
    where
        Self: 'r;

    fn row(&self, y: usize) -> YuvRow<'_> {
        let p = &self.planes;
        YuvRow {
            luma: from_row(p.y, p.y_row_stride, y),
            u: from_row(p.u, p.uv_row_stride, y / 2),
            v: from_row(p.v, p.uv_row_stride, y / 2),
            source: self,
        }
    }
}

impl Row for YuvRow<'_> {
    #[inline(always)]
    fn add(&self, start: usize, end: usize, mut sums: Sums) -> Sums {
        let Yuv { planes, converter, table } = self.source;
        let mut x = start;
        while x < end {
            // As far as the same chroma sample reaches.
            let stop = end.min(x / 2 * 2 + 2);
            let chroma = x / 2 * planes.uv_pixel_stride;
            let (Some(&u), Some(&v)) = (self.u.get(chroma), self.v.get(chroma)) else { break };
            let tint = converter.tint(u, v);
            for x in x..stop {
                let luma = converter.luma(self.luma.get(x * planes.y_pixel_stride).copied().unwrap_or(0));
                for (sum, tint) in sums.iter_mut().zip(tint) {
                    // The mask keeps the index inside, which it is anyway: no bounds check.
                    *sum += table[step(luma, tint) as usize % STEPS];
                }
            }
            x = stop;
        }
        sums
    }
}
