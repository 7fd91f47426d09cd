//! The caller's pixels, format by format: checks at the door, then sums of linear light along a row.
use super::transfer::{WIDE_TABLE, byte_table, fill_wide_table, p3_to_srgb, srgb_to_linear, wide_lookup};
use super::yuv::{Converter, Range, YuvMatrix, YuvPlanes};
use super::{Encoding, MAX_SIDE, resample};
use crate::Error;
use crate::arena::Arena;
use crate::exec::Executor;

/// 8-bit codes from here on count as clipped.
const CLIPPED_BYTE: u8 = 254;
/// 16-bit codes from here on count as clipped.
const CLIPPED_WIDE: u16 = 254 * 257;

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
    Yuv { format: PixelFormat, planes: YuvPlanes<'a>, matrix: YuvMatrix, range: Range },
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
        Ok(Self::Yuv { format, planes, matrix: YuvMatrix::default(), range: Range::default() })
    }

    pub(super) fn yuv_colour(self, matrix: YuvMatrix, range: Range) -> Self {
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

    /// Fills `rgb` (3 planes) and `clipped` (1 plane), not yet turned upright.
    pub(super) fn resample(
        &self,
        window: &resample::Window,
        encoding: Encoding,
        exec: &dyn Executor,
        rgb: &mut [f32],
        clipped: &mut [u8],
        arena: &mut Arena<'_>,
    ) -> Result<(), Error> {
        let curve: fn(f32) -> f32 = if encoding == Encoding::Linear { |x| x } else { srgb_to_linear };
        match *self {
            Self::Bytes { format, data, stride } => {
                let table = byte_table(curve);
                if format == PixelFormat::Rgb8 {
                    resample::run(&Bytes::<3> { data, stride, table: &table }, window, exec, rgb, clipped);
                } else {
                    resample::run(&Bytes::<4> { data, stride, table: &table }, window, exec, rgb, clipped);
                }
                if format == PixelFormat::Bgra8 {
                    let plane = rgb.len() / 3;
                    let (first, rest) = rgb.split_at_mut(plane);
                    first.swap_with_slice(rest.split_at_mut(plane).1);
                }
            }
            Self::Wide { data, stride } => {
                let table = arena.take::<f32>(WIDE_TABLE)?;
                fill_wide_table(table, curve);
                resample::run(&Wide { data, stride, table }, window, exec, rgb, clipped);
            }
            // The identity by itself: a call for every value of a large photo would cost more than the sums.
            Self::Float { data, stride } if encoding == Encoding::Linear => {
                resample::run(&Float { data, stride, curve: |x| x }, window, exec, rgb, clipped);
            }
            Self::Float { data, stride } => {
                resample::run(&Float { data, stride, curve: srgb_to_linear }, window, exec, rgb, clipped);
            }
            Self::Yuv { planes, matrix, range, .. } => {
                let source =
                    Yuv { planes, converter: Converter::new(matrix, range), table: &byte_table(curve) };
                resample::run(&source, window, exec, rgb, clipped);
            }
        }
        if encoding == Encoding::DisplayP3 {
            let (r, gb) = rgb.split_at_mut(rgb.len() / 3);
            let (g, b) = gb.split_at_mut(r.len());
            for ((r, g), b) in r.iter_mut().zip(g).zip(b) {
                [*r, *g, *b] = p3_to_srgb([*r, *g, *b]).map(|v| v.clamp(0.0, 1.0));
            }
        }
        Ok(())
    }
}

/// Linear light of some pixels added up, and whether one of them was clipped.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sum {
    pub(super) rgb: [f32; 3],
    pub(super) clipped: bool,
}

/// Pixels that can be added up along a row.
pub(super) trait Source: Sync {
    /// The sum over columns `start..end` of row `y`. Outside columns and rows count as nothing.
    fn sum(&self, y: usize, start: usize, end: usize) -> Sum;
}

/// Columns `start..end`, `step` values each, of row `y` of rows that are `stride` values apart.
fn span<T>(data: &[T], stride: usize, step: usize, y: usize, start: usize, end: usize) -> &[T] {
    let row = y * stride;
    data.get(row + start * step..row + end * step).unwrap_or(&[])
}

struct Bytes<'a, const STEP: usize> {
    data: &'a [u8],
    stride: usize,
    table: &'a [f32; 256],
}

impl<const STEP: usize> Source for Bytes<'_, STEP> {
    #[inline]
    fn sum(&self, y: usize, start: usize, end: usize) -> Sum {
        let (mut rgb, mut most) = ([0.0; 3], [0; 3]);
        let (pixels, _) = span(self.data, self.stride, STEP, y, start, end).as_chunks::<STEP>();
        for pixel in pixels {
            for ((sum, most), &code) in rgb.iter_mut().zip(&mut most).zip(pixel) {
                *sum += self.table[usize::from(code)];
                *most = code.max(*most);
            }
        }
        Sum { rgb, clipped: most.iter().any(|&code| code >= CLIPPED_BYTE) }
    }
}

struct Wide<'a> {
    data: &'a [u16],
    stride: usize,
    table: &'a [f32],
}

impl Source for Wide<'_> {
    #[inline]
    fn sum(&self, y: usize, start: usize, end: usize) -> Sum {
        let (mut rgb, mut most) = ([0.0; 3], [0; 3]);
        for pixel in span(self.data, self.stride, 3, y, start, end).as_chunks::<3>().0 {
            for ((sum, most), &code) in rgb.iter_mut().zip(&mut most).zip(pixel) {
                *sum += wide_lookup(self.table, code).min(1.0);
                *most = code.max(*most);
            }
        }
        Sum { rgb, clipped: most.iter().any(|&code| code >= CLIPPED_WIDE) }
    }
}

struct Float<'a, C> {
    data: &'a [f32],
    stride: usize,
    curve: C,
}

impl<C: Fn(f32) -> f32 + Sync> Source for Float<'_, C> {
    #[inline]
    fn sum(&self, y: usize, start: usize, end: usize) -> Sum {
        let (mut rgb, mut most) = ([0.0; 3], [0.0_f32; 3]);
        for pixel in span(self.data, self.stride, 3, y, start, end).as_chunks::<3>().0 {
            for ((sum, most), &value) in rgb.iter_mut().zip(&mut most).zip(pixel) {
                *sum += (self.curve)(value.min(1.0));
                *most = value.max(*most);
            }
        }
        Sum { rgb, clipped: most.iter().any(|&value| value >= 1.0) }
    }
}

struct Yuv<'a> {
    planes: YuvPlanes<'a>,
    converter: Converter,
    table: &'a [f32; 256],
}

impl Source for Yuv<'_> {
    #[inline]
    fn sum(&self, y: usize, start: usize, end: usize) -> Sum {
        let p = &self.planes;
        let (luma_row, chroma_row) = (y * p.y_row_stride, y / 2 * p.uv_row_stride);
        let (mut rgb, mut most) = ([0.0; 3], [0; 3]);
        for x in start..end {
            let chroma = chroma_row + x / 2 * p.uv_pixel_stride;
            let (luma, u, v) = (p.y.get(luma_row + x * p.y_pixel_stride), p.u.get(chroma), p.v.get(chroma));
            let (Some(&luma), Some(&u), Some(&v)) = (luma, u, v) else { break };
            for ((sum, most), code) in rgb.iter_mut().zip(&mut most).zip(self.converter.rgb(luma, u, v)) {
                *sum += self.table[usize::from(code)];
                *most = code.max(*most);
            }
        }
        Sum { rgb, clipped: most.iter().any(|&code| code >= CLIPPED_BYTE) }
    }
}
