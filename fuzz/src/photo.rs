//! Photos in memory as cameras give them, right and wrong.
use crate::Bytes;
use crate::core::{Encoding, Error, FieldOfView, Frame, PhotoFov, Range, Rotation, YuvMatrix, YuvPlanes};

/// Values that a plane has at most.
const MOST: usize = 1 << 19;

/// Pixels of one format with all that a frame needs; sizes, strides and lengths may lie.
pub struct Photo {
    format: u8,
    width: usize,
    height: usize,
    /// From row to row of the first plane and of the others; from pixel to pixel, the same.
    rows: [usize; 2],
    pixels: [usize; 2],
    planes: [Vec<u8>; 3],
    wide: Vec<u16>,
    float: Vec<f32>,
    rotation: Rotation,
    encoding: Option<Encoding>,
    matrix: YuvMatrix,
    range: Range,
}

/// Values from the first to the last of `rows` rows of `row` values, `stride` apart.
fn span(rows: usize, row: usize, stride: usize) -> usize {
    rows.saturating_sub(1).saturating_mul(stride).saturating_add(row)
}

impl Photo {
    /// A photo of up to `largest` pixels a side, as a rule.
    pub fn new(bytes: &mut Bytes<'_>, largest: usize) -> Self {
        let format = bytes.u8() % 8;
        let mut side = || {
            let usual = 1 + usize::from(bytes.u16()) % largest;
            bytes.amount(usual)
        };
        let (width, height) = (side(), side());
        let step = [3, 4, 4, 3, 3, 1, 1, 1][usize::from(format)];
        let chroma_step = if format == 7 { 1 } else { 2 };
        let pixels = [bytes.amount(1), bytes.amount(chroma_step)];
        let (chroma_width, chroma_height) = (width.div_ceil(2), height.div_ceil(2));
        let row = width.saturating_mul(step).saturating_mul(if format == 7 { pixels[0] } else { 1 });
        let chroma_row = chroma_width.saturating_mul(if format == 7 { pixels[1] } else { 2 });
        let rows = [bytes.amount(row), bytes.amount(chroma_row)];
        let first = bytes.amount(span(height, row, rows[0])).min(MOST);
        let second = bytes.amount(span(chroma_height, chroma_row, rows[1])).min(MOST);
        let third = bytes.amount(second).min(MOST);
        let (mut planes, mut wide, mut float) = ([vec![], vec![], vec![]], vec![], vec![]);
        match format {
            3 => wide = bytes.fill(first).into_iter().map(|v| u16::from(v) * 257).collect(),
            4 => {
                float = bytes.fill(first).into_iter().map(|v| f32::from(v) / 255.0).collect();
                for _ in 0..bytes.u8() % 4 {
                    let (at, value) = (bytes.u16(), bytes.real(0.0, 2.0));
                    if let Some(slot) = float.get_mut(usize::from(at)) {
                        *slot = value;
                    }
                }
            }
            _ => planes[0] = bytes.fill(first),
        }
        if format >= 5 {
            planes[1] = bytes.fill(second);
        }
        if format == 7 {
            planes[2] = bytes.fill(third);
        }
        let rotation = bytes.pick(&[Rotation::None, Rotation::Cw90, Rotation::Cw180, Rotation::Cw270]);
        let encoding =
            bytes.pick(&[None, Some(Encoding::Srgb), Some(Encoding::Linear), Some(Encoding::DisplayP3)]);
        let matrix = bytes.pick(&[YuvMatrix::Bt601, YuvMatrix::Bt709]);
        let range = bytes.pick(&[Range::Full, Range::Limited]);
        Self { format, width, height, rows, pixels, planes, wide, float, rotation, encoding, matrix, range }
    }

    /// The frame, if the core takes it.
    pub fn frame(&self) -> Result<Frame<'_>, Error> {
        let (w, h, [row, chroma]) = (self.width, self.height, self.rows);
        let [y, u, v] = &self.planes;
        let frame = match self.format {
            0 => Frame::rgb8(y, w, h, row),
            1 => Frame::rgba8(y, w, h, row),
            2 => Frame::bgra8(y, w, h, row),
            3 => Frame::rgb16(&self.wide, w, h, row),
            4 => Frame::rgb_f32(&self.float, w, h, row),
            5 => Frame::nv12(y, row, u, chroma, w, h),
            6 => Frame::nv21(y, row, u, chroma, w, h),
            _ => {
                let planes = YuvPlanes {
                    y,
                    y_row_stride: row,
                    y_pixel_stride: self.pixels[0],
                    u,
                    v,
                    uv_row_stride: chroma,
                    uv_pixel_stride: self.pixels[1],
                };
                Frame::yuv420(planes, w, h)
            }
        }?;
        let frame = frame.rotated(self.rotation).yuv_colour(self.matrix, self.range);
        Ok(self.encoding.map_or(frame, |encoding| frame.encoded(encoding)))
    }
}

/// A field of view, mostly one that makes sense.
pub fn fov(bytes: &mut Bytes<'_>) -> FieldOfView {
    let photo = match bytes.u8() % 3 {
        0 => PhotoFov::Unknown,
        1 => PhotoFov::ShorterSide(bytes.real(1.0, 170.0)),
        _ => PhotoFov::Focal35mm(bytes.real(4.0, 200.0)),
    };
    let target_deg = if bytes.u8() < 200 { FieldOfView::TARGET_DEG } else { bytes.real(1.0, 170.0) };
    FieldOfView { photo, target_deg }
}
