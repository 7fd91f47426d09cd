//! PNG files: pixels, and the chunks that say what they mean.
use super::colour::{Cicp, Icc, Tags};
use super::raster::{self, Sample};
use super::{Decoded, exif};
use crate::failure::Failure;
use png::{BitDepth, ColorType, DecodingError, Info, Limits, Transformations};
use std::io::{BufRead, Seek};
use std::path::Path;

/// Bytes that chunks other than the picture may take.
const CHUNK_BYTES: usize = 64 << 20;

/// Decodes the PNG that `file` reads; `check` sees its size before a pixel is decoded.
pub(super) fn decode(
    path: &Path,
    file: impl BufRead + Seek,
    check: &mut dyn FnMut(u32, u32) -> Result<(), Failure>,
) -> Result<Decoded, Failure> {
    let failed = |error: DecodingError| super::undecodable(path, &error.to_string(), false);
    let mut decoder = png::Decoder::new_with_limits(file, Limits { bytes: CHUNK_BYTES });
    decoder.set_transformations(Transformations::EXPAND);
    let (width, height) = {
        let header = decoder.read_header_info().map_err(failed)?;
        (header.width, header.height)
    };
    check(width, height)?;
    let mut reader = decoder.read_info().map_err(failed)?;
    let (colour, depth) = reader.output_color_type();
    let channels = colour.samples();
    let pixels = width as usize * height as usize;
    let (pixels, transparent) = if depth == BitDepth::Sixteen {
        let mut samples = raster::buffer::<u16>(pixels, channels);
        let room = samples.get_mut(..pixels * channels).unwrap_or(&mut []);
        reader.next_frame(bytemuck::cast_slice_mut(room)).map_err(failed)?;
        room.iter_mut().for_each(|v| *v = u16::from_be(*v));
        let transparent = raster::to_rgb(&mut samples, pixels, channels);
        (u16::pixels(samples), transparent)
    } else {
        let mut samples = raster::buffer::<u8>(pixels, channels);
        let room = samples.get_mut(..pixels * channels).unwrap_or(&mut []);
        reader.next_frame(room).map_err(failed)?;
        let transparent = raster::to_rgb(&mut samples, pixels, channels);
        (u8::pixels(samples), transparent)
    };
    // Chunks may follow the picture; a file that ends before they do has all its pixels.
    let _ = reader.finish();
    let info = reader.info();
    let grey = matches!(colour, ColorType::Grayscale | ColorType::GrayscaleAlpha);
    let blocks = exif_blocks(info);
    let fields = exif::read(blocks.iter().map(Vec::as_slice));
    let decoded = Decoded::new(width, height, pixels, Tags { grey, ..tags(info) }, fields);
    Ok(Decoded { transparent, ..decoded })
}

fn tags(info: &Info<'_>) -> Tags {
    let chromaticities = info
        .chrm_chunk
        .map(|c| [c.white, c.red, c.green, c.blue].map(|(x, y)| [x.into_value(), y.into_value()]));
    Tags {
        cicp: info.coding_independent_code_points.map(|c| Cicp {
            primaries: c.color_primaries,
            transfer: c.transfer_function,
            matrix: c.matrix_coefficients,
            full_range: c.is_video_full_range_image,
        }),
        icc: info.icc_profile.as_ref().map(|profile| Icc::Whole(profile.to_vec())),
        srgb: info.srgb.is_some(),
        gamma: info.gama_chunk.map(png::ScaledFloat::into_value).filter(|g| *g > 0.0),
        chromaticities,
        ..Tags::default()
    }
}

/// The eXIf chunk, and what programs wrote before there was one.
fn exif_blocks(info: &Info<'_>) -> Vec<Vec<u8>> {
    let is_raw = |keyword: &str| {
        ["Raw profile type exif", "Raw profile type APP1"].iter().any(|k| k.eq_ignore_ascii_case(keyword))
    };
    let plain = info.uncompressed_latin1_text.iter().filter(|t| is_raw(&t.keyword)).map(|t| t.text.clone());
    let compressed = info.compressed_latin1_text.iter().filter(|t| is_raw(&t.keyword));
    let compressed = compressed.filter_map(|t| t.get_text().ok());
    let unicode = info.utf8_text.iter().filter(|t| is_raw(&t.keyword)).filter_map(|t| t.get_text().ok());
    let texts = plain.chain(compressed).chain(unicode).filter_map(|text| exif::from_hex_text(&text));
    info.exif_metadata.iter().map(|block| block.to_vec()).chain(texts).collect()
}
