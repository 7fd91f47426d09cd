//! PNG files of planar images, 8 or 16 bits per channel.
use flashmat_core::Error;
use flashmat_core::maps::{self, Maps, Quantum};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::io::{self, Write};

/// Bits per channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]

pub(crate) enum Depth {
    Eight,
    Sixteen,
}

/// A type of which PNG rows are made.
pub(crate) trait Channel: Quantum + bytemuck::Pod {
    const RGB: ExtendedColorType;
    const GREY: ExtendedColorType;
}

impl Channel for u8 {
    const RGB: ExtendedColorType = ExtendedColorType::Rgb8;
    const GREY: ExtendedColorType = ExtendedColorType::L8;
}

impl Channel for u16 {
    const RGB: ExtendedColorType = ExtendedColorType::Rgb16;
    const GREY: ExtendedColorType = ExtendedColorType::L16;
}

/// Interleaved codes of a whole image: `row` fills row after row of `channels` values a pixel.
pub(crate) fn codes<T: Channel>(
    size: usize,
    channels: usize,
    row: impl Fn(usize, &mut [T]) -> Result<(), Error>,
) -> io::Result<Vec<T>> {
    let mut codes = vec![T::zeroed(); channels * size * size];
    for (y, line) in codes.chunks_exact_mut(channels * size).enumerate() {
        row(y, line).map_err(io::Error::other)?;
    }
    Ok(codes)
}

/// Writes the albedo, sRGB-encoded.
pub(crate) fn albedo(out: &mut dyn Write, maps: &Maps<'_>, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => rgb::<u8>(out, maps.size, |y, line| maps.albedo_row(y, line)),
        Depth::Sixteen => rgb::<u16>(out, maps.size, |y, line| maps.albedo_row(y, line)),
    }
}

/// Writes the normals as (n + 1) / 2.
pub(crate) fn normal(out: &mut dyn Write, maps: &Maps<'_>, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => rgb::<u8>(out, maps.size, |y, line| maps.normal_row(y, line)),
        Depth::Sixteen => rgb::<u16>(out, maps.size, |y, line| maps.normal_row(y, line)),
    }
}

/// Writes the roughness, linear grey.
pub(crate) fn roughness(out: &mut dyn Write, maps: &Maps<'_>, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => grey::<u8>(out, maps),
        Depth::Sixteen => grey::<u16>(out, maps),
    }
}

/// Writes three planes of linear RGB, sRGB-encoded.
pub(crate) fn linear(out: &mut dyn Write, planes: &[f32], size: usize, depth: Depth) -> io::Result<()> {
    use flashmat_core::frame::transfer::linear_to_srgb;
    match depth {
        Depth::Eight => {
            rgb::<u8>(out, size, |y, line| maps::encode_rgb_row(planes, size, y, line, linear_to_srgb))
        }
        Depth::Sixteen => {
            rgb::<u16>(out, size, |y, line| maps::encode_rgb_row(planes, size, y, line, linear_to_srgb))
        }
    }
}

fn rgb<T: Channel>(
    out: &mut dyn Write,
    size: usize,
    row: impl Fn(usize, &mut [T]) -> Result<(), Error>,
) -> io::Result<()> {
    encode(out, &codes(size, 3, row)?, size, size, T::RGB)
}

fn grey<T: Channel>(out: &mut dyn Write, maps: &Maps<'_>) -> io::Result<()> {
    encode(
        out,
        &codes(maps.size, 1, |y, line: &mut [T]| maps.roughness_row(y, line))?,
        maps.size,
        maps.size,
        T::GREY,
    )
}

/// Writes `width` x `height` pixels of `colour`.
pub(crate) fn encode<T: Channel>(
    out: &mut dyn Write,
    codes: &[T],
    width: usize,
    height: usize,
    colour: ExtendedColorType,
) -> io::Result<()> {
    let side = |n: usize| u32::try_from(n).map_err(io::Error::other);
    // In memory first: the encoder hides the kind of a writer's error, and a full disk is to be named as such.
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive)
        .write_image(bytemuck::cast_slice(codes), side(width)?, side(height)?, colour)
        .map_err(io::Error::other)?;
    out.write_all(&file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_hold_what_was_written_in_both_depths() {
        let albedo_planes = [0.0, 0.25, 0.5, 1.0, 1.0, 0.5, 0.25, 0.0, 0.1, 0.2, 0.3, 0.4];
        let normals = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 1.0];
        let maps =
            Maps { size: 2, albedo: &albedo_planes, normal: &normals, roughness: &[0.0, 0.25, 0.5, 1.0] };
        let mut file = Vec::new();
        roughness(&mut file, &maps, Depth::Sixteen).expect("write");
        let read = image::load_from_memory(&file).expect("read");
        assert_eq!(read.color(), image::ColorType::L16);
        assert_eq!(read.into_luma16().into_raw(), [0, 16384, 32768, 65535]);
        file.clear();
        normal(&mut file, &maps, Depth::Eight).expect("write");
        let read = image::load_from_memory(&file).expect("read").into_rgb8().into_raw();
        assert_eq!(read, [128, 128, 255, 255, 128, 128, 128, 0, 128, 128, 128, 255]);
        file.clear();
        albedo(&mut file, &maps, Depth::Eight).expect("write");
        let mut same = Vec::new();
        linear(&mut same, &albedo_planes, 2, Depth::Eight).expect("write");
        assert_eq!(file, same);
        assert!(linear(&mut same, &albedo_planes, 3, Depth::Eight).is_err());
    }
}
