//! Photo files: decoding, and what their metadata says.
//!
//! PNG, JPEG, TIFF and WebP; 8 and 16 bits; grey becomes RGB; alpha is left out (a photo is opaque), with a warning
//! where it was not. EXIF orientation is applied. The size is checked before a pixel is decoded.
mod exif;
mod jpeg;

use crate::failure::Failure;
use flashmat_core::frame::transfer::linear_to_srgb;
use flashmat_core::maps;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The most pixels of a photo: the largest phone sensors have 200 million.
const MAX_PIXELS: u64 = 256 << 20;
/// The fewest pixels along a side of a photo.
pub(crate) const MIN_SIDE: u32 = 32;
/// The largest photo file, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Of photos with more pixels than this there is one in memory at a time, whatever the number of threads.
const LARGE_PIXELS: u64 = 32 << 20;
static LARGE: Mutex<()> = Mutex::new(());

const FORMATS_HELP: &str = "give a PNG, JPEG, TIFF or WebP picture";

/// A decoded photo, upright.
pub(crate) struct Photo {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) pixels: Pixels,
    /// The file says that its colours are Display P3.
    pub(crate) display_p3: bool,
    /// 35 mm-equivalent focal length in millimetres, when the file tells.
    pub(crate) focal_35mm: Option<f32>,
    /// What a user should know about how the file was read.
    pub(crate) warnings: Vec<String>,
    /// The turn of a large photo, over when it is dropped.
    _turn: Option<MutexGuard<'static, ()>>,
}

/// Interleaved RGB, top row first.
pub(crate) enum Pixels {
    /// As stored, 8 bits.
    Rgb8(Vec<u8>),
    /// As stored, 16 bits.
    Rgb16(Vec<u16>),
    /// Floating point, which files store linear.
    RgbF32(Vec<f32>),
}

impl Photo {
    /// The photo that an 8-bit sRGB camera takes of `radiance`: 3 planes, linear RGB, `size` a side.
    pub(crate) fn of_radiance(radiance: &[f32], size: usize) -> Result<Self, flashmat_core::Error> {
        let mut pixels = vec![0_u8; 3 * size * size];
        for (y, line) in pixels.chunks_exact_mut(3 * size.max(1)).enumerate() {
            maps::encode_rgb_row(radiance, size, y, line, linear_to_srgb)?;
        }
        let side = u32::try_from(size).map_err(|_| flashmat_core::Error::Size { size })?;
        Ok(Self::plain(side, side, Pixels::Rgb8(pixels)))
    }

    /// Pixels of which nothing more is known.
    pub(crate) fn plain(width: u32, height: u32, pixels: Pixels) -> Self {
        Self { width, height, pixels, display_p3: false, focal_35mm: None, warnings: Vec::new(), _turn: None }
    }
}

/// Reads and decodes the photo at `path`.
pub(crate) fn read(path: &Path) -> Result<Photo, Failure> {
    let bytes = read_bytes(path)?;
    let format = image::guess_format(&bytes).ok().filter(|f| {
        matches!(f, ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Tiff | ImageFormat::WebP)
    });
    let Some(format) = format else { return Err(unknown_format(path, &bytes)) };
    if format == ImageFormat::Jpeg && !jpeg::is_complete(&bytes) {
        return Err(Failure::new(
            path,
            "the JPEG is cut short",
            "copy it from the phone again; part of the file is missing",
        ));
    }
    let broken = |error: &image::ImageError| {
        Failure::new(path, format!("cannot be decoded: {}", brief(error)), broken_help(error))
    };
    let mut reader = ImageReader::with_format(Cursor::new(&bytes), format);
    reader.limits(Limits::no_limits());
    let mut decoder = reader.into_decoder().map_err(|e| broken(&e))?;
    let (width, height) = decoder.dimensions();
    check_size(path, width, height)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_PIXELS * 16);
    decoder.set_limits(limits).map_err(|e| broken(&e))?;
    let display_p3 = decoder.icc_profile().ok().flatten().is_some_and(|p| names_display_p3(&p));
    let large = u64::from(width) * u64::from(height) > LARGE_PIXELS;
    let turn = large.then(|| LARGE.lock().unwrap_or_else(PoisonError::into_inner));
    let mut picture = DynamicImage::from_decoder(decoder).map_err(|e| broken(&e))?;
    let facts = exif::read(&bytes);
    drop(bytes);
    if let Some(orientation) = facts.orientation.and_then(Orientation::from_exif) {
        picture.apply_orientation(orientation);
    }
    let mut warnings = Vec::new();
    if has_transparency(&picture) {
        warnings.push("the photo is partly transparent: its alpha channel was left out".to_owned());
    }
    let (width, height) = (picture.width(), picture.height());
    let focal_35mm = facts.focal_35mm;
    Ok(Photo {
        display_p3,
        focal_35mm,
        warnings,
        _turn: turn,
        ..Photo::plain(width, height, into_pixels(picture))
    })
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    let metadata = fs::metadata(path).map_err(|e| Failure::reading(path, &e))?;
    if metadata.is_dir() {
        return Err(Failure::new(path, "is a folder", "name the photos in it, as in FOLDER/*.jpg"));
    }
    if !metadata.is_file() {
        return Err(Failure::new(path, "is not a file", FORMATS_HELP));
    }
    if metadata.len() == 0 {
        return Err(Failure::new(path, "the file is empty", "copy it from the phone again"));
    }
    if metadata.len() > MAX_FILE_BYTES {
        return Err(Failure::new(
            path,
            format!(
                "the file has {} MiB, more than the {} allowed",
                metadata.len() >> 20,
                MAX_FILE_BYTES >> 20
            ),
            "give a smaller picture",
        ));
    }
    fs::read(path).map_err(|e| Failure::reading(path, &e))
}

fn unknown_format(path: &Path, bytes: &[u8]) -> Failure {
    let is_heif = bytes.get(4..12).is_some_and(|b| {
        [b"ftypheic", b"ftypheix", b"ftypmif1", b"ftypmsf1", b"ftypavif"].iter().any(|brand| b == *brand)
    });
    if is_heif {
        let help = "convert it to JPEG, or let the phone take JPEG (iPhone: Settings, Camera, Formats, Most Compatible)";
        Failure::new(path, "is an HEIF or AVIF picture, which Flashmat does not read", help)
    } else {
        Failure::new(path, "is not a picture that Flashmat reads", FORMATS_HELP)
    }
}

fn check_size(path: &Path, width: u32, height: u32) -> Result<(), Failure> {
    let what = format!("the picture has {width} x {height} pixels");
    if width.min(height) < MIN_SIDE {
        let help = format!("give a photo of at least {MIN_SIDE} pixels a side; 256 and more are useful");
        return Err(Failure::new(path, format!("{what}, too few to see a material in"), help));
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        let help = "scale it down; more than 2000 pixels a side add nothing";
        return Err(Failure::new(path, format!("{what}, too many to decode safely"), help));
    }
    Ok(())
}

fn broken_help(error: &image::ImageError) -> &'static str {
    match error {
        image::ImageError::Unsupported(_) => "save it as an ordinary PNG or JPEG",
        _ => "the file is damaged: copy it from the phone again",
    }
}

/// The decoder's message as one short line.
fn brief(error: &image::ImageError) -> String {
    let text = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    match text.char_indices().nth(160) {
        Some((end, _)) => format!("{}...", text.get(..end).unwrap_or("")),
        None => text,
    }
}

/// Whether an ICC profile calls itself Display P3, in ASCII or UTF-16.
fn names_display_p3(profile: &[u8]) -> bool {
    let ascii: &[u8] = b"Display P3";
    let wide: Vec<u8> = ascii.iter().flat_map(|&b| [0, b]).collect();
    [ascii, &wide].iter().any(|name| profile.windows(name.len()).any(|w| w == *name))
}

fn has_transparency(picture: &DynamicImage) -> bool {
    match picture {
        DynamicImage::ImageLumaA8(p) => p.pixels().any(|p| p.0[1] != u8::MAX),
        DynamicImage::ImageRgba8(p) => p.pixels().any(|p| p.0[3] != u8::MAX),
        DynamicImage::ImageLumaA16(p) => p.pixels().any(|p| p.0[1] != u16::MAX),
        DynamicImage::ImageRgba16(p) => p.pixels().any(|p| p.0[3] != u16::MAX),
        DynamicImage::ImageRgba32F(p) => p.pixels().any(|p| p.0[3] < 1.0),
        _ => false,
    }
}

fn into_pixels(picture: DynamicImage) -> Pixels {
    use image::DynamicImage as P;
    match picture {
        P::ImageLuma16(_) | P::ImageLumaA16(_) | P::ImageRgb16(_) | P::ImageRgba16(_) => {
            Pixels::Rgb16(picture.into_rgb16().into_raw())
        }
        P::ImageRgb32F(_) | P::ImageRgba32F(_) => Pixels::RgbF32(picture.into_rgb32f().into_raw()),
        _ => Pixels::Rgb8(picture.into_rgb8().into_raw()),
    }
}

#[cfg(test)]
mod tests;
