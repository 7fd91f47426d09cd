//! A frame as `com.flashmat.Frame` packs it: numbers in an `int[]`, pixels in one to three direct buffers.
use crate::{Failure, buffer};
use flashmat_core::frame::{Encoding, Frame, Range, Rotation, YuvMatrix, YuvPlanes};
use jni::Env;
use jni::objects::{JByteBuffer, JIntArray};

/// Values of the `int[]`, in the order of `Frame.java`.
const FIELDS: usize = 11;

/// The `int[]`, named.
pub(crate) struct Layout {
    format: i32,
    width: usize,
    height: usize,
    row_stride: usize,
    pixel_stride: usize,
    chroma_row_stride: usize,
    chroma_pixel_stride: usize,
    rotation: Rotation,
    encoding: Encoding,
    matrix: YuvMatrix,
    range: Range,
}

/// The buffers of a frame; those that its format does not have are null.
pub(crate) struct Planes<'r, 'local> {
    pub(crate) first: &'r JByteBuffer<'local>,
    pub(crate) second: &'r JByteBuffer<'local>,
    pub(crate) third: &'r JByteBuffer<'local>,
}

/// The pixels of a frame.
pub(crate) struct Pixels<'b> {
    planes: [&'b [u8]; 3],
}

impl<'b> Pixels<'b> {
    /// The memory of all planes.
    pub(crate) fn planes(&self) -> &[&'b [u8]] {
        &self.planes
    }
}

fn pick<T: Copy>(choices: &[T], code: i32, what: &str) -> Result<T, Failure> {
    let choice = usize::try_from(code).ok().and_then(|code| choices.get(code));
    choice.copied().ok_or_else(|| Failure::Argument(format!("no {what} has the number {code}")))
}

impl Layout {
    pub(crate) fn read(env: &Env<'_>, array: &JIntArray<'_>) -> Result<Self, Failure> {
        if array.is_null() {
            return Err(Failure::Null("layout"));
        }
        let mut values = [0; FIELDS];
        if array.len(env)? != FIELDS {
            return Err(Failure::Argument(format!("a frame's layout has {FIELDS} values")));
        }
        array.get_region(env, 0, &mut values)?;
        Self::from_values(&values)
    }

    fn from_values(values: &[i32; FIELDS]) -> Result<Self, Failure> {
        let [format, width, height, row, pixel, chroma_row, chroma_pixel, rotation, encoding, matrix, range] =
            *values;
        let size = |value: i32, what: &str| {
            usize::try_from(value).map_err(|_| Failure::Argument(format!("{what} is negative: {value}")))
        };
        Ok(Self {
            format,
            width: size(width, "width")?,
            height: size(height, "height")?,
            row_stride: size(row, "row stride")?,
            pixel_stride: size(pixel, "pixel stride")?,
            chroma_row_stride: size(chroma_row, "chroma row stride")?,
            chroma_pixel_stride: size(chroma_pixel, "chroma pixel stride")?,
            rotation: pick(
                &[Rotation::None, Rotation::Cw90, Rotation::Cw180, Rotation::Cw270],
                rotation,
                "rotation",
            )?,
            encoding: pick(&[Encoding::Srgb, Encoding::Linear, Encoding::DisplayP3], encoding, "encoding")?,
            matrix: pick(&[YuvMatrix::Bt601, YuvMatrix::Bt709], matrix, "YUV matrix")?,
            range: pick(&[Range::Full, Range::Limited], range, "range")?,
        })
    }

    /// Buffers that the format has.
    fn plane_count(&self) -> usize {
        match self.format {
            format::NV12 | format::NV21 => 2,
            format::YUV420 => 3,
            _ => 1,
        }
    }

    /// The memory of the buffers that the format has.
    pub(crate) fn pixels<'b>(&self, env: &Env<'_>, planes: &Planes<'b, '_>) -> Result<Pixels<'b>, Failure> {
        let buffers = [(planes.first, "plane 0"), (planes.second, "plane 1"), (planes.third, "plane 2")];
        let mut slices: [&[u8]; 3] = [&[]; 3];
        for (slice, (buffer, what)) in slices.iter_mut().zip(buffers).take(self.plane_count()) {
            *slice = buffer::read(env, buffer, what)?;
        }
        Ok(Pixels { planes: slices })
    }

    /// Core's view of the pixels: all lengths and strides are checked there.
    pub(crate) fn frame<'b>(&self, pixels: &Pixels<'b>) -> Result<Frame<'b>, Failure> {
        let (width, height, row) = (self.width, self.height, self.row_stride);
        let [first, second, third] = pixels.planes;
        let frame = match self.format {
            format::RGB8 => Frame::rgb8(first, width, height, row)?,
            format::RGBA8 => Frame::rgba8(first, width, height, row)?,
            format::BGRA8 => Frame::bgra8(first, width, height, row)?,
            format::RGB16 => Frame::rgb16(wide(first)?, width, height, row)?,
            format::RGB_F32 => Frame::rgb_f32(wide(first)?, width, height, row)?,
            format::NV12 => Frame::nv12(first, row, second, self.chroma_row_stride, width, height)?,
            format::NV21 => Frame::nv21(first, row, second, self.chroma_row_stride, width, height)?,
            format::YUV420 => Frame::yuv420(
                YuvPlanes {
                    y: first,
                    y_row_stride: row,
                    y_pixel_stride: self.pixel_stride,
                    u: second,
                    v: third,
                    uv_row_stride: self.chroma_row_stride,
                    uv_pixel_stride: self.chroma_pixel_stride,
                },
                width,
                height,
            )?,
            other => return Err(Failure::Argument(format!("no pixel format has the number {other}"))),
        };
        Ok(frame.rotated(self.rotation).encoded(self.encoding).yuv_colour(self.matrix, self.range))
    }
}

/// Ordinals of `PixelFormat.java`.
mod format {
    pub(super) const RGB8: i32 = 0;
    pub(super) const RGBA8: i32 = 1;
    pub(super) const BGRA8: i32 = 2;
    pub(super) const RGB16: i32 = 3;
    pub(super) const RGB_F32: i32 = 4;
    pub(super) const NV12: i32 = 5;
    pub(super) const NV21: i32 = 6;
    pub(super) const YUV420: i32 = 7;
}

/// Bytes as wider values: whole values at an aligned address; a rest of fewer bytes than a value is not read.
fn wide<T: bytemuck::Pod>(bytes: &[u8]) -> Result<&[T], Failure> {
    let whole = bytes.len() - bytes.len() % size_of::<T>();
    bytemuck::try_cast_slice(&bytes[..whole]).map_err(|_| {
        Failure::Argument(format!(
            "pixels of {} bytes must begin at a multiple of it in memory",
            size_of::<T>()
        ))
    })
}
