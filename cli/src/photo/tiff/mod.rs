//! TIFF and BigTIFF files: the full-resolution picture, in every sample format that is a picture's.
//!
//! Strips and tiles are decoded from the file straight to their place in the picture, so that the file's bytes are
//! never in memory as a whole. Integers of up to 16 bits stay as they are; floats of 16 and 64 bits become 32-bit ones.
//! Signed integers and those of more bits are refused: nothing tells what their white is.
mod directory;

use super::colour::{Icc, Tags};
use super::container::RAW_HELP;
use super::raster::{self, Sample};
use super::{Decoded, exif};
use crate::failure::Failure;
use directory::{Directories, Directory, StartingAt, tag};
use flashmat_core::frame::Encoding;
use std::io::{BufRead, Seek};
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult, DecodingSampleType, Limits};
use tiff::{ColorType, TiffError};

const ORDINARY_HELP: &str = "save it as a TIFF of 8 or 16-bit RGB, or as PNG";
/// Photometric interpretations of raw photos: a colour filter array, and linear raw.
const RAW_PHOTOMETRIC: [u64; 2] = [32803, 34892];
/// Compressions of Nikon's, Sony's, Pentax's and Samsung's raw photos.
const RAW_COMPRESSION: [u64; 5] = [34713, 32767, 65535, 32769, 32770];

/// Decodes the TIFF that `file` reads; `check` sees its size before a pixel is decoded.
pub(super) fn decode(
    path: &Path,
    mut file: impl BufRead + Seek,
    check: &mut dyn FnMut(u32, u32) -> Result<(), Failure>,
) -> Result<Decoded, Failure> {
    let mut directories = Directories::new(&mut file).map_err(|e| Failure::reading(path, &e))?;
    let mut warnings = Vec::new();
    let page = choose(path, &mut directories, &mut warnings)?;
    let fields = exif_fields(&mut directories, &page);
    let icc = directories.bytes(&page, tag::ICC_PROFILE).map(Icc::Whole);
    let size = |d: &mut Directories<'_, _>, tag| d.first(&page, tag).and_then(|v| u32::try_from(v).ok());
    let (width, height) = (size(&mut directories, tag::WIDTH), size(&mut directories, tag::HEIGHT));
    let (Some(width), Some(height)) = (width, height) else {
        return Err(super::undecodable(path, "the TIFF holds no picture", false));
    };
    check(width, height)?;
    let failed = |error: TiffError| {
        let unsupported = matches!(error, TiffError::UnsupportedError(_));
        super::undecodable(path, &error.to_string(), unsupported)
    };
    let file = StartingAt::new(file, page.at).map_err(|e| Failure::reading(path, &e))?;
    let decoder = Decoder::new(file).map_err(failed)?;
    let mut decoder = decoder.with_limits(limits(u64::from(width) * u64::from(height)));
    let colour = decoder.colortype().map_err(failed)?;
    let layout = decoder.image_buffer_layout().map_err(failed)?;
    let refuse = |what: &str| {
        Err(Failure::new(path, format!("is a TIFF of {what}, which is not supported"), ORDINARY_HELP))
    };
    let bits = colour.bit_depth();
    let (channels, ink) = match colour {
        ColorType::Gray(_) => (1, false),
        ColorType::Multiband { num_samples: 2, .. } | ColorType::GrayA(_) => (2, false),
        ColorType::RGB(_) => (3, false),
        ColorType::RGBA(_) => (4, false),
        ColorType::CMYK(8 | 16) => (4, true),
        ColorType::YCbCr(_) => return refuse("YCbCr colours"),
        ColorType::Lab(_) => return refuse("Lab colours"),
        ColorType::Palette(_) => return refuse("palette colours"),
        _ => return refuse("unusual channels"),
    };
    let pixels = width as usize * height as usize;
    let shape = Shape { width: width as usize, height: height as usize, channels, planes: layout.planes };
    let mut encoding = Encoding::Srgb;
    let mut transparent = false;
    let picture = match layout.sample_type {
        Some(DecodingSampleType::U8) if bits < 8 && channels == 1 => {
            let mut samples = raster::buffer::<u8>(pixels, channels);
            few_bits(&mut decoder, &shape, bits, &mut samples).map_err(failed)?;
            raster::to_rgb(&mut samples, pixels, channels);
            u8::pixels(samples)
        }
        Some(DecodingSampleType::U8) if bits == 8 => {
            let mut samples = raster::buffer::<u8>(pixels, channels);
            whole(&mut decoder, &shape, &mut samples).map_err(failed)?;
            transparent = finish(&mut samples, &shape, ink);
            u8::pixels(samples)
        }
        Some(DecodingSampleType::U16) if bits == 16 => {
            let mut samples = raster::buffer::<u16>(pixels, channels);
            whole(&mut decoder, &shape, &mut samples).map_err(failed)?;
            transparent = finish(&mut samples, &shape, ink);
            u16::pixels(samples)
        }
        Some(DecodingSampleType::F32) => {
            encoding = Encoding::Linear;
            let mut samples = raster::buffer::<f32>(pixels, channels);
            whole(&mut decoder, &shape, &mut samples).map_err(failed)?;
            transparent = raster::to_rgb(&mut samples, pixels, channels);
            f32::pixels(samples)
        }
        Some(DecodingSampleType::F16 | DecodingSampleType::F64) => {
            encoding = Encoding::Linear;
            let mut samples = raster::buffer::<f32>(pixels, channels);
            converted(&mut decoder, &shape, &mut samples).map_err(failed)?;
            transparent = raster::to_rgb(&mut samples, pixels, channels);
            f32::pixels(samples)
        }
        Some(DecodingSampleType::U32 | DecodingSampleType::U64) => {
            // Some programs use their full range, some 16 bits of it: nothing in the file tells which.
            return refuse(&format!("{bits}-bit integers"));
        }
        Some(
            DecodingSampleType::I8
            | DecodingSampleType::I16
            | DecodingSampleType::I32
            | DecodingSampleType::I64,
        ) => {
            return refuse("signed integers");
        }
        _ => return refuse(&format!("{bits}-bit samples")),
    };
    let tags = Tags { icc, grey: channels <= 2, ink, ..Tags::default() };
    Ok(Decoded { warnings, transparent, encoding, ..Decoded::new(width, height, picture, tags, fields) })
}

fn limits(pixels: u64) -> Limits {
    // Chunks are no larger than the picture.
    let most = usize::try_from(pixels.saturating_mul(64).saturating_add(1 << 20)).unwrap_or(usize::MAX);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = most;
    limits.intermediate_buffer_size = most;
    limits.ifd_value_size = 64 << 20;
    limits
}

/// The directory of the picture at full resolution: the largest that is neither reduced nor a mask.
fn choose<R: BufRead + Seek>(
    path: &Path,
    directories: &mut Directories<'_, R>,
    warnings: &mut Vec<String>,
) -> Result<Directory, Failure> {
    let chain = directories.chain();
    let mut all = Vec::new();
    for (i, directory) in chain.iter().enumerate() {
        all.push((i, directory.clone()));
        all.extend(directories.below(directory, tag::SUB_DIRECTORIES).into_iter().map(|d| (i, d)));
    }
    let raw = all.iter().find_map(|(_, directory)| raw_kind(directories, directory));
    if let Some(kind) = raw {
        let extension = path.extension().map(|e| e.to_string_lossy().to_uppercase()).filter(|e| e.len() == 3);
        let kind = extension.filter(|e| e != "TIF" && kind != "DNG").unwrap_or_else(|| kind.to_owned());
        let what = format!("is a raw photo ({kind}), which Flashmat does not read");
        return Err(Failure::new(path, what, RAW_HELP));
    }
    let mut pictures: Vec<(u64, bool, Directory)> = Vec::new();
    for (_, directory) in all {
        let kind = directories.first(&directory, tag::NEW_SUBFILE_TYPE).unwrap_or(0);
        let old_kind = directories.first(&directory, tag::SUBFILE_TYPE).unwrap_or(1);
        let photometric = directories.first(&directory, tag::PHOTOMETRIC);
        // Bit 2, and photometric interpretation 4: a transparency mask.
        if kind & 4 != 0 || photometric == Some(4) {
            continue;
        }
        let sides = [tag::WIDTH, tag::HEIGHT].map(|t| directories.first(&directory, t).unwrap_or(0));
        let reduced = kind & 1 != 0 || old_kind == 2;
        pictures.push((sides[0].saturating_mul(sides[1]), reduced, directory));
    }
    let full = pictures.iter().filter(|(_, reduced, _)| !reduced).count();
    // The first of the largest ones.
    let best = pictures.into_iter().rev().max_by_key(|(area, reduced, _)| (!reduced, *area));
    let Some((_, reduced, directory)) = best.filter(|(area, ..)| *area > 0) else {
        return Err(super::undecodable(path, "the TIFF holds no picture", false));
    };
    if reduced {
        warnings.push("the TIFF holds only reduced pictures: the largest of them is used".to_owned());
    } else if full > 1 {
        warnings.push(format!("the TIFF holds {full} pictures: the largest of them is used"));
    }
    Ok(directory)
}

/// The kind of raw photo that has such a directory.
fn raw_kind<R: BufRead + Seek>(
    directories: &mut Directories<'_, R>,
    directory: &Directory,
) -> Option<&'static str> {
    if directory.has(tag::DNG_VERSION) {
        return Some("DNG");
    }
    let photometric = directories.first(directory, tag::PHOTOMETRIC);
    let compression = directories.first(directory, tag::COMPRESSION);
    let is_raw = photometric.is_some_and(|p| RAW_PHOTOMETRIC.contains(&p))
        || compression.is_some_and(|c| RAW_COMPRESSION.contains(&c));
    if is_raw { Some("of a camera") } else { None }
}

/// The EXIF fields of a page: TIFF keeps them in its own directories.
fn exif_fields<R: BufRead + Seek>(directories: &mut Directories<'_, R>, page: &Directory) -> exif::Fields {
    let orientation = directories.first(page, tag::ORIENTATION);
    let mut fields = exif::Fields {
        orientation: orientation.filter(|v| (1..=8).contains(v)).map(|v| v as u8),
        ..exif::Fields::default()
    };
    let below = directories.below(page, tag::EXIF_DIRECTORY);
    fields.broken = page.has(tag::EXIF_DIRECTORY) && below.is_empty();
    let Some(exif) = below.first() else { return fields };
    let count = |v: u64| u32::try_from(v).ok();
    let positive = |v: &f32| *v > 0.0;
    fields.focal_35mm = directories.real(exif, 0xa405).filter(positive);
    fields.focal = directories.real(exif, 0x920a).filter(positive);
    fields.plane_resolution = directories.real(exif, 0xa20e).filter(positive);
    fields.plane_unit = directories.first(exif, 0xa210).and_then(count);
    let sides = [0xa002, 0xa003].map(|t| directories.first(exif, t).and_then(count));
    fields.pixels = sides[0].zip(sides[1]);
    fields.colour_space = directories.first(exif, 0xa001).and_then(count);
    let interoperability = directories.below(exif, tag::INTEROPERABILITY);
    let index = interoperability.first().and_then(|d| directories.bytes(d, 1));
    fields.adobe_by_interoperability = index.is_some_and(|text| text.starts_with(b"R03"));
    fields
}

struct Shape {
    width: usize,
    height: usize,
    channels: usize,
    /// More than 1: each channel lies by itself.
    planes: usize,
}

type File<R> = Decoder<StartingAt<R>>;

/// Decodes a picture whose samples are those that are wanted, to the front of `samples`.
fn whole<R: BufRead + Seek, T: Sample + bytemuck::Pod>(
    decoder: &mut File<R>,
    shape: &Shape,
    samples: &mut [T],
) -> Result<(), TiffError> {
    if shape.planes <= 1 {
        let room = samples.get_mut(..shape.width * shape.height * shape.channels).unwrap_or(&mut []);
        return decoder.read_image_bytes(bytemuck::cast_slice_mut(room));
    }
    let mut piece: Vec<T> = Vec::new();
    chunks(decoder, shape, |decoder, chunk, place| {
        // The decoder may count padding as data.
        let bytes = decoder.image_chunk_buffer_layout(chunk)?.len;
        piece.resize(bytes.div_ceil(size_of::<T>()), T::default());
        decoder.read_chunk_bytes(chunk, bytemuck::cast_slice_mut(&mut piece))?;
        scatter(shape, place, &piece, samples, |v| v);
        Ok(())
    })
}

/// Decodes a picture of floats of 16 or 64 bits, a strip or tile at a time.
fn converted<R: BufRead + Seek>(
    decoder: &mut File<R>,
    shape: &Shape,
    samples: &mut [f32],
) -> Result<(), TiffError> {
    chunks(decoder, shape, |decoder, chunk, place| {
        match decoder.read_chunk(chunk)? {
            DecodingResult::F16(piece) => scatter(shape, place, &piece, samples, |v| v.to_f32()),
            DecodingResult::F64(piece) => scatter(shape, place, &piece, samples, |v| v as f32),
            _ => return Err(TiffError::UnsupportedError(tiff::TiffUnsupportedError::UnknownInterpretation)),
        }
        Ok(())
    })
}

/// Grey of 1, 2 or 4 bits, a row at a time padded to bytes.
fn few_bits<R: BufRead + Seek>(
    decoder: &mut File<R>,
    shape: &Shape,
    bits: u8,
    samples: &mut [u8],
) -> Result<(), TiffError> {
    let (per_byte, most) = (8 / usize::from(bits.max(1)), u8::MAX >> (8 - bits.clamp(1, 7)));
    chunks(decoder, shape, |decoder, chunk, place| {
        let mut packed = vec![0_u8; decoder.image_chunk_buffer_layout(chunk)?.len];
        decoder.read_chunk_bytes(chunk, &mut packed)?;
        let mut piece = Vec::with_capacity(place.width * place.height);
        for row in packed.chunks_exact(place.width.div_ceil(per_byte)) {
            piece.extend((0..place.width).map(|x| {
                let byte = row.get(x / per_byte).copied().unwrap_or(0);
                let shift = 8 - bits * (x % per_byte + 1) as u8;
                (byte >> shift & most) * (u8::MAX / most)
            }));
        }
        scatter(shape, place, &piece, samples, |v| v);
        Ok(())
    })
}

/// Where a strip or tile lies in the picture.
#[derive(Clone, Copy)]
struct Place {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    /// Channels that it holds, from `channel` on.
    channels: usize,
    channel: usize,
}

/// Calls `each` for every strip or tile.
fn chunks<R: BufRead + Seek>(
    decoder: &mut File<R>,
    shape: &Shape,
    mut each: impl FnMut(&mut File<R>, u32, Place) -> Result<(), TiffError>,
) -> Result<(), TiffError> {
    let (wide, high) = decoder.chunk_dimensions();
    let (wide, high) = ((wide as usize).max(1), (high as usize).max(1));
    let (across, down) = (shape.width.div_ceil(wide), shape.height.div_ceil(high));
    let planar = shape.planes > 1;
    let planes = if planar { shape.channels.min(shape.planes) } else { 1 };
    for plane in 0..planes {
        for i in 0..across * down {
            let chunk = u32::try_from(plane * across * down + i)?;
            let (x, y) = (i % across * wide, i / across * high);
            let place = Place {
                x,
                y,
                width: wide.min(shape.width - x),
                height: high.min(shape.height - y),
                channels: if planar { 1 } else { shape.channels },
                channel: plane,
            };
            each(decoder, chunk, place)?;
        }
    }
    Ok(())
}

/// Puts a strip or tile in its place; rows of padding below it are left out.
fn scatter<S: Copy, T>(
    shape: &Shape,
    place: Place,
    piece: &[S],
    samples: &mut [T],
    convert: impl Fn(S) -> T,
) {
    let rows = piece.chunks_exact((place.width * place.channels).max(1));
    for (row, y) in rows.zip(place.y..place.y + place.height) {
        let start = (y * shape.width + place.x) * shape.channels + place.channel;
        let end = start + place.width * shape.channels - place.channel;
        let Some(target) = samples.get_mut(start..end) else { return };
        if place.channels == shape.channels {
            target.iter_mut().zip(row).for_each(|(to, from)| *to = convert(*from));
        } else {
            target.iter_mut().step_by(shape.channels).zip(row).for_each(|(to, from)| *to = convert(*from));
        }
    }
}

/// To RGB in place; whether a pixel was transparent.
fn finish<T: Sample + Ink>(samples: &mut Vec<T>, shape: &Shape, ink: bool) -> bool {
    let pixels = shape.width * shape.height;
    if !ink {
        return raster::to_rgb(samples, pixels, shape.channels);
    }
    for pixel in samples.chunks_exact_mut(4) {
        if let [c, m, y, k] = pixel {
            let light = k.complement();
            [*c, *m, *y] = [*c, *m, *y].map(|ink| ink.complement().times(light));
        }
    }
    raster::to_rgb(samples, pixels, 4);
    false
}

/// Arithmetic of inks: 0 is none, the highest value all of it.
trait Ink {
    fn complement(self) -> Self;
    fn times(self, other: Self) -> Self;
}

impl Ink for u8 {
    fn complement(self) -> Self {
        Self::MAX - self
    }
    fn times(self, other: Self) -> Self {
        ((u16::from(self) * u16::from(other) + 127) / 255) as Self
    }
}

impl Ink for u16 {
    fn complement(self) -> Self {
        Self::MAX - self
    }
    fn times(self, other: Self) -> Self {
        ((u32::from(self) * u32::from(other) + 32767) / 65535) as Self
    }
}

#[cfg(test)]
mod tests;
