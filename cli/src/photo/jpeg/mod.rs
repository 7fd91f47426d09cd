//! JPEG files: their segments, whether every block of the picture has data, and the decoding.
//!
//! The decoder fills what is missing with grey and says nothing, so [`scan`] follows the entropy-coded data first.
mod bits;
mod block;
mod scan;

use super::colour::{Icc, Tags};
use super::{Decoded, Pixels, exif, raster};
use crate::failure::Failure;
use scan::Verdict;
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// A share of missing blocks from here on is refused; less is a warning.
const REFUSED_SHARE: f64 = 0.02;
const ORDINARY_HELP: &str = "save it as an ordinary JPEG or PNG";
const COPY_HELP: &str = "copy it from the phone again";
const END_OF_IMAGE: [u8; 2] = [0xff, 0xd9];

/// Decodes the JPEG in `bytes`; `check` sees its size before a pixel is decoded.
pub(super) fn decode(
    path: &Path,
    mut bytes: Vec<u8>,
    check: &mut dyn FnMut(u32, u32) -> Result<(), Failure>,
) -> Result<Decoded, Failure> {
    let file = scan::read(&bytes);
    if let Some(kind) = file.unsupported {
        return Err(Failure::new(
            path,
            format!("is a JPEG with {kind}, which is not supported"),
            ORDINARY_HELP,
        ));
    }
    let Some((width, height)) = file.size else {
        return Err(Failure::new(path, "the JPEG is cut short before its picture begins", COPY_HELP));
    };
    check(width, height)?;
    let mut warnings = Vec::new();
    warnings.extend(judge(path, &file.verdict)?);
    let fields = exif::read(file.exif.iter().map(|range| bytes.get(range.clone()).unwrap_or(&[])));
    let icc = icc_profile(&bytes, &file.icc);
    let whole = !matches!(file.verdict, Verdict::Unknown);
    if whole {
        // The decoder sees the picture and its end, whatever follows or is missing in the file.
        bytes.truncate(file.end);
        bytes.extend(END_OF_IMAGE);
    }
    let failed = |error: DecodeErrors| {
        let text = super::brief(&error.to_string());
        match error {
            // All data is there: the file is not to blame.
            _ if whole => {
                Failure::new(path, format!("is a kind of JPEG that is not supported: {text}"), ORDINARY_HELP)
            }
            DecodeErrors::Unsupported(_) => {
                Failure::new(path, format!("is a kind of JPEG that is not supported: {text}"), ORDINARY_HELP)
            }
            _ => Failure::new(
                path,
                format!("cannot be decoded: {text}"),
                format!("the file is damaged: {COPY_HELP}"),
            ),
        }
    };
    let options =
        DecoderOptions::default().set_strict_mode(false).set_max_width(usize::MAX).set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes.as_slice()), options);
    decoder.decode_headers().map_err(failed)?;
    let input = decoder.input_colorspace().unwrap_or(ColorSpace::RGB);
    let (output, channels) = match input {
        ColorSpace::Luma => (ColorSpace::Luma, 1),
        ColorSpace::RGB | ColorSpace::YCbCr | ColorSpace::CMYK | ColorSpace::YCCK => (ColorSpace::RGB, 3),
        _ => {
            let what = "is a JPEG with an unusual number of channels, which is not supported";
            return Err(Failure::new(path, what, ORDINARY_HELP));
        }
    };
    decoder.set_options(decoder.options().jpeg_set_out_colorspace(output));
    let pixels = width as usize * height as usize;
    let mut samples = raster::buffer::<u8>(pixels, channels);
    let room = samples.get_mut(..pixels * channels).unwrap_or(&mut []);
    decoder.decode_into(room).map_err(failed)?;
    raster::to_rgb(&mut samples, pixels, channels);
    let ink = matches!(input, ColorSpace::CMYK | ColorSpace::YCCK);
    let tags = Tags { icc, grey: channels == 1, ink, ..Tags::default() };
    Ok(Decoded { warnings, ..Decoded::new(width, height, Pixels::Rgb8(samples), tags, fields) })
}

/// A damaged picture is refused, or warned of where little is missing.
fn judge(path: &Path, verdict: &Verdict) -> Result<Option<String>, Failure> {
    match *verdict {
        Verdict::Whole | Verdict::Unknown => Ok(None),
        Verdict::Missing { share, another } if share > REFUSED_SHARE => {
            let what = match (another, share) {
                (true, _) => "the JPEG is cut short: another JPEG begins inside its picture",
                (false, _) => "the JPEG is cut short or damaged",
            };
            let percent = (100.0 * share).round().max(1.0);
            let help = format!("{COPY_HELP}; about {percent:.0} % of its picture is missing");
            Err(Failure::new(path, what, help))
        }
        Verdict::Missing { share, .. } => {
            let percent = (100.0 * share).max(0.1);
            Ok(Some(format!("the JPEG is damaged: about {percent:.1} % of its picture is missing")))
        }
        Verdict::Surplus { bytes } => Ok(Some(format!(
            "the JPEG is damaged: {bytes} bytes of its data belong to no part of the picture, which may be garbled"
        ))),
        Verdict::Coarse => Ok(Some(
            "the JPEG is cut short: its last passes are missing, and with them the fine detail".to_owned(),
        )),
    }
}

/// The profile of APP2 segments in their order, whatever order they stand in.
fn icc_profile(bytes: &[u8], segments: &[std::ops::Range<usize>]) -> Option<Icc> {
    let mut parts: Vec<(u8, u8, &[u8])> = segments
        .iter()
        .filter_map(|range| match bytes.get(range.clone())? {
            [number, count, data @ ..] => Some((*number, *count, data)),
            _ => None,
        })
        .collect();
    parts.sort_by_key(|(number, ..)| *number);
    let &(_, count, _) = parts.first()?;
    let complete = parts.len() == usize::from(count) && parts.iter().zip(1..).all(|((n, ..), i)| *n == i);
    if !complete {
        return Some(Icc::Broken);
    }
    Some(Icc::Whole(parts.iter().flat_map(|(.., data)| *data).copied().collect()))
}

#[cfg(test)]
mod tests;
