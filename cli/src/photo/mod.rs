//! Photo files: decoding, and what their metadata says.
//!
//! PNG, JPEG, TIFF and WebP; 8 and 16 bits, 32 in TIFFs; grey becomes RGB; alpha is left out (a photo is opaque), with
//! a warning where it was not. The size is checked before a pixel is decoded. `docs/photos.md` says what is read, what
//! is a warning and what is refused.
//!
//! A large picture is in memory once: files are decoded into the buffer that the core reads, whatever is done to the
//! pixels is done in place, and the core turns them upright.
mod colour;
mod container;
mod exif;
mod jpeg;
mod png;
mod raster;
mod tiff;
mod webp;

use crate::failure::Failure;
use colour::Tags;
use container::Container;
use flashmat_core::frame::{Encoding, Rotation};
use flashmat_core::maps::{Coding, encode_row};
use std::fs::{self, File};
use std::io::{BufReader, Read, Seek};
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

/// A decoded photo, as stored.
pub(crate) struct Photo {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) pixels: Pixels,
    /// What the pixels' values mean.
    pub(crate) encoding: Encoding,
    /// How the pixels must be turned to stand upright.
    pub(crate) rotation: Rotation,
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
    /// Floating point.
    RgbF32(Vec<f32>),
}

impl Photo {
    /// The photo that an 8-bit sRGB camera takes of `radiance`: 3 planes, linear RGB, `size` a side.
    pub(crate) fn of_radiance(radiance: &[f32], size: usize) -> Result<Self, flashmat_core::Error> {
        let mut pixels = vec![0_u8; 3 * size * size];
        for (y, line) in pixels.chunks_exact_mut(3 * size.max(1)).enumerate() {
            encode_row(radiance, size, y, Coding::Srgb, line)?;
        }
        let side = u32::try_from(size).map_err(|_| flashmat_core::Error::Size { size })?;
        Ok(Self::plain(side, side, Pixels::Rgb8(pixels)))
    }

    /// Pixels of which nothing more is known: sRGB, floats linear.
    pub(crate) fn plain(width: u32, height: u32, pixels: Pixels) -> Self {
        let encoding = match pixels {
            Pixels::Rgb8(_) | Pixels::Rgb16(_) => Encoding::Srgb,
            Pixels::RgbF32(_) => Encoding::Linear,
        };
        let (rotation, focal_35mm, warnings) = (Rotation::None, None, Vec::new());
        Self { width, height, pixels, encoding, rotation, focal_35mm, warnings, _turn: None }
    }
}

/// What a container's reader hands over.
struct Decoded {
    width: u32,
    height: u32,
    pixels: Pixels,
    /// What the values mean if no tag tells.
    encoding: Encoding,
    tags: Tags,
    exif: exif::Fields,
    transparent: bool,
    warnings: Vec<String>,
}

impl Decoded {
    fn new(width: u32, height: u32, pixels: Pixels, tags: Tags, exif: exif::Fields) -> Self {
        let encoding = Encoding::Srgb;
        Self { width, height, pixels, encoding, tags, exif, transparent: false, warnings: Vec::new() }
    }
}

/// Reads and decodes the photo at `path`; its values mean what the file says.
pub(crate) fn read(path: &Path) -> Result<Photo, Failure> {
    read_as(path, None)
}

/// As [`read`], but where `encoding` is given it wins over all that the file says.
pub(crate) fn read_as(path: &Path, encoding: Option<Encoding>) -> Result<Photo, Failure> {
    let (mut decoded, turn) = decode(path)?;
    let mut warnings = std::mem::take(&mut decoded.warnings);
    warnings.extend(decoded.exif.loss());
    let focal_35mm = decoded.exif.focal_35mm(decoded.width, decoded.height, &mut warnings);
    if decoded.transparent {
        warnings.push("the photo is partly transparent: its alpha channel was left out".to_owned());
    }
    let encoding = encoding.unwrap_or_else(|| {
        let (tags, colours) = (&decoded.tags, decoded.exif.colours());
        colour::resolve(&mut decoded.pixels, tags, colours, decoded.encoding, &mut warnings)
    });
    Ok(Photo { encoding, focal_35mm, warnings, _turn: turn, ..upright(decoded) })
}

/// Reads a picture that holds a map: its values are taken as they are, whatever profile the file names.
pub(crate) fn read_map(path: &Path) -> Result<Photo, Failure> {
    let (decoded, turn) = decode(path)?;
    Ok(Photo { _turn: turn, ..upright(decoded) })
}

/// Mirrors the pixels and finds their turn, by EXIF's orientation.
fn upright(decoded: Decoded) -> Photo {
    let orientation = decoded.exif.orientation.unwrap_or(1);
    let mut photo = Photo::plain(decoded.width, decoded.height, decoded.pixels);
    if matches!(orientation, 2 | 4 | 5 | 7) {
        raster::mirror(&mut photo.pixels, photo.width as usize);
    }
    photo.rotation = match orientation {
        3 | 4 => Rotation::Cw180,
        6 | 7 => Rotation::Cw90,
        5 | 8 => Rotation::Cw270,
        _ => Rotation::None,
    };
    photo
}

fn decode(path: &Path) -> Result<(Decoded, Option<MutexGuard<'static, ()>>), Failure> {
    let mut file = open(path)?;
    let reading = |error: std::io::Error| Failure::reading(path, &error);
    let mut head = Vec::new();
    (&mut file).take(container::HEAD as u64).read_to_end(&mut head).map_err(reading)?;
    let container = container::sniff(path, &head)?;
    file.rewind().map_err(reading)?;
    let mut turn = None;
    let mut check = |width: u32, height: u32| {
        check_size(path, width, height)?;
        if u64::from(width) * u64::from(height) > LARGE_PIXELS {
            turn = Some(LARGE.lock().unwrap_or_else(PoisonError::into_inner));
        }
        Ok(())
    };
    let mut all = || {
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map(|_| bytes).map_err(reading)
    };
    let decoded = match container {
        Container::Jpeg => jpeg::decode(path, all()?, &mut check),
        Container::WebP => webp::decode(path, &all()?, &mut check),
        Container::Png => png::decode(path, BufReader::new(file), &mut check),
        Container::Tiff => tiff::decode(path, BufReader::new(file), &mut check),
    }?;
    Ok((decoded, turn))
}

fn open(path: &Path) -> Result<File, Failure> {
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
    File::open(path).map_err(|e| Failure::reading(path, &e))
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

/// A decoder's failure: of the file, or of what the decoder knows.
fn undecodable(path: &Path, error: &str, unsupported: bool) -> Failure {
    let text = brief(error);
    if unsupported {
        let what = format!("cannot be decoded: not supported: {text}");
        return Failure::new(path, what, "save it as an ordinary PNG, JPEG or TIFF");
    }
    let help = "the file is damaged: copy it from the phone again";
    Failure::new(path, format!("cannot be decoded: {text}"), help)
}

/// A decoder's message as one short line.
fn brief(error: &str) -> String {
    let text = error.split_whitespace().collect::<Vec<_>>().join(" ");
    match text.char_indices().nth(160) {
        Some((end, _)) => format!("{}...", text.get(..end).unwrap_or("")),
        None => text,
    }
}

#[cfg(test)]
mod tests;
