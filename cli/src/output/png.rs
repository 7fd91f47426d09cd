//! The maps as PNG files, 8 or 16 bits per channel.
use flashmat_core::Error;
use flashmat_core::maps::{Coding, Maps, encode_row};
use flashmat_export::png::{self, Channel, Colour};
use std::io::{self, Write};

/// Bits per channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Depth {
    Eight,
    Sixteen,
}

/// Writes the albedo, sRGB-encoded.
pub(crate) fn albedo(out: &mut dyn Write, maps: &Maps<'_>, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => square::<u8>(out, maps.size, Colour::Rgb, |y, line| maps.albedo_row(y, line)),
        Depth::Sixteen => square::<u16>(out, maps.size, Colour::Rgb, |y, line| maps.albedo_row(y, line)),
    }
}

/// Writes the normals as (n + 1) / 2.
pub(crate) fn normal(out: &mut dyn Write, maps: &Maps<'_>, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => square::<u8>(out, maps.size, Colour::Rgb, |y, line| maps.normal_row(y, line)),
        Depth::Sixteen => square::<u16>(out, maps.size, Colour::Rgb, |y, line| maps.normal_row(y, line)),
    }
}

/// Writes the roughness, linear grey.
pub(crate) fn roughness(out: &mut dyn Write, maps: &Maps<'_>, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => square::<u8>(out, maps.size, Colour::Grey, |y, line| maps.roughness_row(y, line)),
        Depth::Sixteen => square::<u16>(out, maps.size, Colour::Grey, |y, line| maps.roughness_row(y, line)),
    }
}

/// Writes three planes of linear RGB, sRGB-encoded.
pub(crate) fn linear(out: &mut dyn Write, planes: &[f32], size: usize, depth: Depth) -> io::Result<()> {
    match depth {
        Depth::Eight => {
            square::<u8>(out, size, Colour::Rgb, |y, line| encode_row(planes, size, y, Coding::Srgb, line))
        }
        Depth::Sixteen => {
            square::<u16>(out, size, Colour::Rgb, |y, line| encode_row(planes, size, y, Coding::Srgb, line))
        }
    }
}

fn square<T: Channel>(
    out: &mut dyn Write,
    size: usize,
    colour: Colour,
    row: impl Fn(usize, &mut [T]) -> Result<(), Error>,
) -> io::Result<()> {
    let file = png::file((size, size), colour, |y, line| Ok(row(y, line)?)).map_err(io::Error::other)?;
    out.write_all(&file)
}

/// Writes a picture of 8-bit RGB codes.
pub(crate) fn rgb8(out: &mut dyn Write, codes: &[u8], size: (usize, usize)) -> io::Result<()> {
    let width = 3 * size.0;
    let row = |y: usize, line: &mut [u8]| {
        line.iter_mut().zip(codes.iter().skip(y * width)).for_each(|(to, &from)| *to = from);
        Ok(())
    };
    let file = png::file(size, Colour::Rgb, row).map_err(io::Error::other)?;
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
