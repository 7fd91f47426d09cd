//! WebP files.
use super::colour::{Icc, Tags};
use super::raster::{self, Sample};
use super::{Decoded, exif};
use crate::failure::Failure;
use image::codecs::webp::WebPDecoder;
use image::{ImageDecoder, ImageError, Limits};
use std::io::Cursor;
use std::path::Path;

/// Decodes the WebP in `bytes` (of an animation the first frame); `check` sees its size before a pixel is decoded.
pub(super) fn decode(
    path: &Path,
    bytes: &[u8],
    check: &mut dyn FnMut(u32, u32) -> Result<(), Failure>,
) -> Result<Decoded, Failure> {
    let failed = |error: ImageError| {
        let unsupported = matches!(error, ImageError::Unsupported(_));
        super::undecodable(path, &error.to_string(), unsupported)
    };
    let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    check(width, height)?;
    decoder.set_limits(Limits::no_limits()).map_err(failed)?;
    let icc = decoder.icc_profile().ok().flatten().map(Icc::Whole);
    let exif = decoder.exif_metadata().ok().flatten();
    let fields = exif::read(exif.as_deref());
    let channels = usize::from(decoder.color_type().channel_count());
    let pixels = width as usize * height as usize;
    let mut samples = raster::buffer::<u8>(pixels, channels);
    let room = samples.get_mut(..pixels * channels).unwrap_or(&mut []);
    decoder.read_image(room).map_err(failed)?;
    let transparent = raster::to_rgb(&mut samples, pixels, channels);
    let tags = Tags { icc, ..Tags::default() };
    Ok(Decoded { transparent, ..Decoded::new(width, height, u8::pixels(samples), tags, fields) })
}
