//! PNG files against the `png` crate: what it reads is what was written.
use flashmat_export::png::{self, Channel, Colour};
use flashmat_export::{Error, Pictures};
use std::io::Cursor;

/// Colour type, depth and bytes of a file, by the `png` crate, which checks CRC and Adler sums.
fn read(file: &[u8]) -> (::png::ColorType, ::png::BitDepth, (u32, u32), Vec<u8>) {
    let mut reader = ::png::Decoder::new(Cursor::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("pixels");
    reader.finish().expect("whole to the last chunk");
    (info.color_type, info.bit_depth, (info.width, info.height), bytes)
}

fn encode<T: Channel>(codes: &[T], width: usize, height: usize, colour: Colour) -> Vec<u8> {
    let values = width * colour.channels();
    let row = |y: usize, line: &mut [T]| {
        line.copy_from_slice(&codes[y * values..(y + 1) * values]);
        Ok(())
    };
    png::file((width, height), colour, row).expect("a file")
}

/// Flat, ramps along both axes, noise, and a texture: each is best for another filter.
fn patterns(width: usize, height: usize, channels: usize) -> Vec<Vec<u32>> {
    let mut state = 7_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 16
    };
    let make = |f: &mut dyn FnMut(u32, u32, u32) -> u32| {
        let mut out = Vec::new();
        for y in 0..height as u32 {
            for x in 0..width as u32 {
                out.extend((0..channels as u32).map(|c| f(x, y, c)));
            }
        }
        out
    };
    vec![
        make(&mut |_, _, _| 0x8123),
        make(&mut |x, _, c| 3 * x + c),
        make(&mut |_, y, c| 513 * y + c),
        make(&mut |x, y, c| 700 * x + 300 * y + 7 * c),
        make(&mut |_, _, _| noise()),
        make(&mut |x, y, _| (x * y) ^ (x << 8)),
    ]
}

#[test]
fn pictures_of_every_kind_are_read_back() {
    for (width, height) in [(1, 1), (1, 9), (7, 1), (33, 20), (128, 128)] {
        for (colour, kind) in
            [(Colour::Grey, ::png::ColorType::Grayscale), (Colour::Rgb, ::png::ColorType::Rgb)]
        {
            for pattern in patterns(width, height, colour.channels()) {
                let narrow: Vec<u8> = pattern.iter().map(|&v| v as u8).collect();
                let file = encode(&narrow, width, height, colour);
                let size = (width as u32, height as u32);
                assert_eq!(read(&file), (kind, ::png::BitDepth::Eight, size, narrow));
                let wide: Vec<u16> = pattern.iter().map(|&v| v as u16).collect();
                let file = encode(&wide, width, height, colour);
                let bytes = wide.iter().flat_map(|v| v.to_be_bytes()).collect();
                assert_eq!(read(&file), (kind, ::png::BitDepth::Sixteen, size, bytes));
            }
        }
    }
}

/// A smooth picture of 256² is a fraction of its raw size, whatever its slope: the filters and deflate work.
#[test]
fn smooth_pictures_are_small() {
    for pattern in &patterns(256, 256, 3)[..4] {
        let codes: Vec<u8> = pattern.iter().map(|&v| (v >> 8) as u8).collect();
        let file = encode(&codes, 256, 256, Colour::Rgb);
        assert!(file.len() < codes.len() / 20, "{} bytes of {}", file.len(), codes.len());
    }
}

#[test]
fn no_pixels_and_too_many_are_errors() {
    let nothing = |_: usize, _: &mut [u16]| Ok(());
    assert_eq!(png::file((0, 4), Colour::Grey, nothing), Err(Error::Size));
    assert_eq!(png::file((4, 0), Colour::Grey, nothing), Err(Error::Size));
    assert_eq!(png::file((usize::MAX, 1), Colour::Rgb, nothing), Err(Error::Size));
    assert_eq!(png::file((1 << 30, 1), Colour::Rgb, nothing), Err(Error::Size));
}

#[test]
fn an_error_of_a_row_ends_the_file() {
    let short = Pictures::Codes { size: 2, albedo: &[0; 6], normal: &[0; 12], roughness: &[0; 4] };
    let error = short.check().expect_err("half of the albedo is missing");
    let failing = |y: usize, _: &mut [u8]| if y < 3 { Ok(()) } else { Err(error) };
    assert_eq!(png::file((4, 8), Colour::Rgb, failing), Err(error));
}
