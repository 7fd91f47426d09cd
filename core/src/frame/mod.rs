//! The caller's photo, validated once, to linear RGB at the network's size.
//!
//! [`Frame`] borrows pixels as cameras and decoders give them: packed 8-bit, 16-bit or float RGB, or YUV 4:2:0 with
//! any row and pixel strides. [`prepare`] crops the central square to the asked field of view, averages in linear
//! light to `size` x `size` (exact box weights; bilinear where the photo is smaller), turns it upright and marks
//! clipped pixels. Source rows are read where they lie: no full-size copy is made.
//!
//! Output: planar f32, linear light, sRGB primaries, white = 1, in [0,1].
//!
//! Every size down to 1x1 is accepted: a photo with fewer pixels than asked is interpolated, a 1x1 photo (or the
//! centre of a 50,000x1 one) gives a constant image. [`Frame::crop`] tells callers who want to refuse such photos.
mod exposure;
pub mod geometry;
mod pixels;
#[cfg(test)]
mod properties;
mod resample;
pub mod srgb8;
#[cfg(test)]
mod tests;
pub mod transfer;
mod yuv;

pub use exposure::{ALL_CLIPPED, CLIPPED_AREA, CLIPPED_BYTE, CLIPPED_WIDE, DARK, Exposure, OVEREXPOSED};
pub use pixels::PixelFormat;
pub use yuv::{Range, YuvMatrix, YuvPlanes};

use crate::Error;
use crate::base::arena::Arena;
use crate::base::exec::Executor;
use crate::base::math::{atanf, sqrtf, tanf};
use crate::base::planes::{MAX_SIZE, check_planes};
use glam::Vec3;
use pixels::Pixels;

/// Largest side of a photo, in pixels (keeps pixel positions exact and sizes within 32-bit platforms' reach).
pub const MAX_SIDE: usize = 1 << 20;

/// Focal lengths, 35 mm equivalent, that are believed, in mm. The widest lenses that draw straight lines have 8 or 9; what is
/// less is a phone's real focal length (4 to 9), which would crop the photo to a tenth.
pub const FOCAL_35MM: core::ops::RangeInclusive<f32> = 8.0..=5000.0;

/// How the sensor's image must be turned, clockwise, to stand upright.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rotation {
    /// Upright as it is.
    #[default]
    None,
    /// A quarter turn clockwise (EXIF orientation 6).
    Cw90,
    /// Half a turn (EXIF orientation 3).
    Cw180,
    /// A quarter turn counter-clockwise (EXIF orientation 8).
    Cw270,
}

/// What the pixel values mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// sRGB curve, sRGB primaries.
    Srgb,
    /// Linear light, sRGB primaries.
    Linear,
    /// sRGB curve, Display P3 primaries; colours outside sRGB are clamped.
    DisplayP3,
}

/// A validated view of a photo: size, strides and lengths agree, floats are finite and not negative.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    pixels: Pixels<'a>,
    width: usize,
    height: usize,
    rotation: Rotation,
    encoding: Encoding,
}

impl<'a> Frame<'a> {
    /// Packed 8-bit R, G, B; `stride` in bytes from row to row. sRGB-encoded unless [`Frame::encoded`] says otherwise.
    ///
    /// # Errors
    /// [`Error::FrameEmpty`], [`Error::FrameTooLarge`], [`Error::FrameStride`], [`Error::FrameBuffer`].
    pub fn rgb8(data: &'a [u8], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        Self::new(Pixels::bytes(PixelFormat::Rgb8, data, width, height, stride)?, width, height)
    }

    /// Packed 8-bit R, G, B, A; alpha is not read. As [`Frame::rgb8`].
    ///
    /// # Errors
    /// As [`Frame::rgb8`].
    pub fn rgba8(data: &'a [u8], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        Self::new(Pixels::bytes(PixelFormat::Rgba8, data, width, height, stride)?, width, height)
    }

    /// Packed 8-bit B, G, R, A; alpha is not read. As [`Frame::rgb8`].
    ///
    /// # Errors
    /// As [`Frame::rgb8`].
    pub fn bgra8(data: &'a [u8], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        Self::new(Pixels::bytes(PixelFormat::Bgra8, data, width, height, stride)?, width, height)
    }

    /// Packed 16-bit R, G, B in native byte order; `stride` in values. sRGB-encoded unless told otherwise.
    ///
    /// # Errors
    /// As [`Frame::rgb8`].
    pub fn rgb16(data: &'a [u16], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        Self::new(Pixels::wide(data, width, height, stride)?, width, height)
    }

    /// Packed f32 R, G, B; `stride` in values. Linear unless told otherwise; 1 is the sensor's white: values above
    /// are taken as 1, as a camera would, and count as clipped.
    ///
    /// # Errors
    /// As [`Frame::rgb8`], and [`Error::FramePixel`] for NaN, infinite and negative values.
    pub fn rgb_f32(data: &'a [f32], width: usize, height: usize, stride: usize) -> Result<Self, Error> {
        let frame = Self::new(Pixels::float(data, width, height, stride)?, width, height)?;
        Ok(Self { encoding: Encoding::Linear, ..frame })
    }

    /// Semi-planar YUV 4:2:0, U before V; strides in bytes. BT.601, full range, unless [`Frame::yuv_colour`] says
    /// otherwise.
    ///
    /// # Errors
    /// As [`Frame::rgb8`].
    pub fn nv12(
        y: &'a [u8],
        y_stride: usize,
        uv: &'a [u8],
        uv_stride: usize,
        width: usize,
        height: usize,
    ) -> Result<Self, Error> {
        let planes = YuvPlanes::semi_planar(y, y_stride, uv, uv_stride, false);
        Self::new(Pixels::yuv(PixelFormat::Nv12, planes, width, height)?, width, height)
    }

    /// Semi-planar YUV 4:2:0, V before U. As [`Frame::nv12`].
    ///
    /// # Errors
    /// As [`Frame::rgb8`].
    pub fn nv21(
        y: &'a [u8],
        y_stride: usize,
        vu: &'a [u8],
        vu_stride: usize,
        width: usize,
        height: usize,
    ) -> Result<Self, Error> {
        let planes = YuvPlanes::semi_planar(y, y_stride, vu, vu_stride, true);
        Self::new(Pixels::yuv(PixelFormat::Nv21, planes, width, height)?, width, height)
    }

    /// YUV 4:2:0 in three planes (I420, or Android's `YUV_420_888`) with row and pixel strides. As [`Frame::nv12`].
    ///
    /// # Errors
    /// As [`Frame::rgb8`].
    pub fn yuv420(planes: YuvPlanes<'a>, width: usize, height: usize) -> Result<Self, Error> {
        Self::new(Pixels::yuv(PixelFormat::Yuv420, planes, width, height)?, width, height)
    }

    fn new(pixels: Pixels<'a>, width: usize, height: usize) -> Result<Self, Error> {
        Ok(Self { pixels, width, height, rotation: Rotation::None, encoding: Encoding::Srgb })
    }

    /// The same pixels, to be turned by `rotation`.
    #[must_use]
    pub fn rotated(self, rotation: Rotation) -> Self {
        Self { rotation, ..self }
    }

    /// The same pixels with another meaning.
    #[must_use]
    pub fn encoded(self, encoding: Encoding) -> Self {
        Self { encoding, ..self }
    }

    /// The same YUV pixels with another matrix and range; other formats stay as they are.
    #[must_use]
    pub fn yuv_colour(self, matrix: YuvMatrix, range: Range) -> Self {
        Self { pixels: self.pixels.yuv_colour(matrix, range), ..self }
    }

    /// Layout of the pixels.
    #[must_use]
    pub fn format(&self) -> PixelFormat {
        self.pixels.format()
    }

    /// Pixels across, as stored (before the rotation).
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels down, as stored (before the rotation).
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The central square that `fov` asks for.
    ///
    /// # Errors
    /// [`Error::FieldOfView`] when an angle makes no sense, [`Error::FocalLength`] when a focal length is outside
    /// [`FOCAL_35MM`].
    pub fn crop(&self, fov: &FieldOfView) -> Result<Crop, Error> {
        let (width, height) = (self.width as f64, self.height as f64);
        let shorter = width.min(height);
        let (part, fov_deg) = fov.resolve(self.width, self.height)?;
        let side = shorter * f64::from(part);
        Ok(Crop { x: (width - side) / 2.0, y: (height - side) / 2.0, side, fov_deg })
    }
}

/// A central square of a photo, in its stored pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crop {
    /// Left border.
    pub x: f64,
    /// Top border.
    pub y: f64,
    /// Side; below the size asked of [`prepare`], pixels are interpolated.
    pub side: f64,
    /// Field of view over the side, in degrees.
    pub fov_deg: f32,
}

/// What is known of the photo's field of view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PhotoFov {
    /// Nothing: the whole central square is kept and taken to span the target.
    #[default]
    Unknown,
    /// Angle over the photo's shorter side, in degrees.
    ShorterSide(f32),
    /// Focal length in mm, 35 mm equivalent (by the diagonal of 43.27 mm, as EXIF 2.3 and CIPA DCG-001 have it), within
    /// [`FOCAL_35MM`].
    Focal35mm(f32),
}

/// The field of view that the photo has and the one that the square should have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldOfView {
    /// The photo's.
    pub photo: PhotoFov,
    /// Wanted over the square, in degrees. A wider photo is cropped to it; of a narrower one the whole central square
    /// is kept and its true angle reported.
    pub target_deg: f32,
}

impl Default for FieldOfView {
    fn default() -> Self {
        Self { photo: PhotoFov::Unknown, target_deg: Self::TARGET_DEG }
    }
}

impl FieldOfView {
    /// The angle that the network was trained for (the paper's section "Rendering synthetic training dataset").
    pub const TARGET_DEG: f32 = 43.35;

    /// The photo's shorter side spans `degrees`.
    #[must_use]
    pub fn shorter_side(degrees: f32) -> Self {
        Self { photo: PhotoFov::ShorterSide(degrees), ..Self::default() }
    }

    /// The photo was taken at a 35 mm-equivalent focal length of `mm`.
    #[must_use]
    pub fn focal_35mm(mm: f32) -> Self {
        Self { photo: PhotoFov::Focal35mm(mm), ..Self::default() }
    }

    /// Part of the shorter side to keep, and the angle over it.
    fn resolve(&self, width: usize, height: usize) -> Result<(f32, f32), Error> {
        const HALF_DIAGONAL_MM: f32 = 21.633_308;
        let half_tan = |degrees: f32| {
            if degrees.is_finite() && (1.0..=170.0).contains(&degrees) {
                Ok(tanf(degrees.to_radians() / 2.0))
            } else {
                Err(Error::FieldOfView)
            }
        };
        let target = half_tan(self.target_deg)?;
        let photo = match self.photo {
            PhotoFov::Unknown => return Ok((1.0, self.target_deg)),
            PhotoFov::ShorterSide(degrees) => half_tan(degrees)?,
            PhotoFov::Focal35mm(mm) => {
                if !FOCAL_35MM.contains(&mm) {
                    return Err(Error::FocalLength);
                }
                let (w, h) = (width as f32, height as f32);
                HALF_DIAGONAL_MM / mm * (w.min(h) / sqrtf(w * w + h * h))
            }
        };
        if photo > target {
            Ok((target / photo, self.target_deg))
        } else {
            Ok((1.0, 2.0 * atanf(photo).to_degrees()))
        }
    }
}

/// A photo as the pipeline sees it: square, linear, upright.
#[derive(Clone, Copy, Debug)]
pub struct LinearImage<'a> {
    /// Pixels per side.
    pub size: usize,
    /// 3 planes, linear RGB, [0,1].
    pub rgb: &'a [f32],
    /// 1 plane of bits: bit 0 where red is clipped by a share of the pixel's area, bit 1 green, bit 2 blue
    /// ([`CLIPPED_AREA`]); [`ALL_CLIPPED`] where all are.
    pub clipped: &'a [u8],
    /// How much of the photo is clipped, and how bright the rest is.
    pub exposure: Exposure,
    /// Field of view over the square, in degrees.
    pub fov_deg: f32,
    /// Linear value that a flat white Lambertian surface at the centre would have under the flash alone, if the caller
    /// knows it (design: exposure times the flash's strength); positive.
    pub light_scale: Option<f32>,
    /// Where the flash is, in plane units: the plane is z = 0, the camera at (0,0,1), and there the flash is too as far as
    /// nothing is known of it ([`search::flash_position`](crate::search::flash_position)).
    pub flash: Vec3,
}

impl<'a> LinearImage<'a> {
    /// A photo of which nothing more is known: no light scale, the flash at the camera.
    #[must_use]
    pub fn new(size: usize, rgb: &'a [f32], clipped: &'a [u8], fov_deg: f32) -> Self {
        let exposure = Exposure::default();
        Self { size, rgb, clipped, exposure, fov_deg, light_scale: None, flash: Vec3::Z }
    }

    /// Checks that the planes have the lengths that `size` asks for.
    ///
    /// # Errors
    /// As [`check_planes`].
    pub fn check(&self) -> Result<(), Error> {
        check_planes(self.size, 3, self.rgb.len())?;
        check_planes(self.size, 1, self.clipped.len())
    }
}

/// Bytes that [`prepare`] takes from the arena and keeps, plus what it needs for itself on the way; more than there are for
/// sizes over [`MAX_SIZE`].
#[must_use]
pub const fn prepare_bytes(size: usize) -> usize {
    use crate::base::arena::bytes_for;
    if size > MAX_SIZE {
        return usize::MAX;
    }
    bytes_for::<f32>(3 * size * size)
        + bytes_for::<u8>(size * size)
        + bytes_for::<f32>(transfer::WIDE_TABLE)
        + resample::scratch_bytes(size)
}

/// Crops, averages to `size` x `size` in linear light, turns upright, marks clipped pixels; planes come from `arena`.
///
/// [`Exposure`] tells how many of the photo's own pixels are clipped ([`CLIPPED_BYTE`]); `clipped` marks, channel by
/// channel, where at least [`CLIPPED_AREA`] of a pixel's area is. Display P3's channels count as sRGB's.
///
/// # Errors
/// [`Error::Size`] unless 1 <= `size` <= [`MAX_SIZE`], [`Error::FieldOfView`], [`Error::FocalLength`],
/// [`Error::WorkspaceTooSmall`].
pub fn prepare<'a>(
    frame: &Frame<'_>,
    size: usize,
    fov: &FieldOfView,
    exec: &dyn Executor,
    arena: &mut Arena<'a>,
) -> Result<LinearImage<'a>, Error> {
    if size == 0 || size > MAX_SIZE {
        return Err(Error::Size { size });
    }
    let crop = frame.crop(fov)?;
    let rgb = arena.take::<f32>(3 * size * size)?;
    let clipped = arena.take::<u8>(size * size)?;
    let mut scope = arena.scope();
    let window = resample::Window::new(&crop, frame.width, frame.height, size);
    let shares = frame.pixels.resample(&window, frame.encoding, exec, rgb, clipped, &mut scope)?;
    exposure::settle(clipped);
    for plane in rgb.chunks_exact_mut(size * size) {
        geometry::rotate_square(plane, size, frame.rotation);
    }
    geometry::rotate_square(clipped, size, frame.rotation);
    let exposure = Exposure { clipped: shares, brightness: 0.0 };
    Ok(LinearImage { exposure, ..LinearImage::new(size, rgb, clipped, crop.fov_deg) })
}
