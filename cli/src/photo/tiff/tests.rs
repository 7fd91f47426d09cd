use super::*;
use crate::photo::Pixels;
use std::io::Cursor;
use tiff::encoder::colortype::{self, ColorType as Samples};
use tiff::encoder::{TiffEncoder, TiffValue};
use tiff::tags::Tag;

const WIDTH: u32 = 40;
const HEIGHT: u32 = 36;

/// A value in [0,1] for each sample of an RGB picture.
fn value(i: usize) -> f64 {
    (i * 7919 % 1000) as f64 / 1000.0
}

fn values(width: u32, height: u32) -> Vec<f64> {
    (0..3 * (width * height) as usize).map(value).collect()
}

type Extra = (u16, Vec<u32>);

/// One page of a file.
struct Page {
    width: u32,
    height: u32,
    extra: Vec<Extra>,
}

impl Page {
    fn plain() -> Self {
        Self { width: WIDTH, height: HEIGHT, extra: Vec::new() }
    }
    fn with(tag: u16, value: u32) -> Self {
        Self { extra: vec![(tag, vec![value])], ..Self::plain() }
    }
}

fn write<C: Samples>(pages: &[Page], sample: impl Fn(f64) -> C::Inner) -> Vec<u8>
where
    [C::Inner]: TiffValue,
{
    let mut bytes = Vec::new();
    let mut encoder = TiffEncoder::new(Cursor::new(&mut bytes)).expect("encoder");
    for page in pages {
        let mut image = encoder.new_image::<C>(page.width, page.height).expect("image");
        for (tag, value) in &page.extra {
            image.encoder().write_tag(Tag::from_u16_exhaustive(*tag), value.as_slice()).expect("tag");
        }
        let samples: Vec<_> = values(page.width, page.height).into_iter().map(&sample).collect();
        image.write_data(&samples).expect("data");
    }
    bytes
}

fn read_named(name: &str, bytes: &[u8]) -> Result<Decoded, String> {
    decode(Path::new(name), Cursor::new(bytes), &mut |_, _| Ok(())).map_err(|failure| failure.to_string())
}

fn read(bytes: &[u8]) -> Result<Decoded, String> {
    read_named("x.tif", bytes)
}

fn assert_values(decoded: &Decoded, tolerance: f64) {
    let read: Vec<f64> = match &decoded.pixels {
        Pixels::Rgb8(p) => p.iter().map(|&v| f64::from(v) / 255.0).collect(),
        Pixels::Rgb16(p) => p.iter().map(|&v| f64::from(v) / 65535.0).collect(),
        Pixels::RgbF32(p) => p.iter().map(|&v| v.into()).collect(),
    };
    let wanted = values(decoded.width, decoded.height);
    assert_eq!(read.len(), wanted.len());
    let worst = read.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst <= tolerance, "off by {worst}");
}

fn eight(v: f64) -> u8 {
    (v * 255.0).round() as u8
}

#[test]
fn every_sample_format_keeps_its_values() {
    let cases = [
        (write::<colortype::RGB8>(&[Page::plain()], eight), Encoding::Srgb, 0.002),
        (write::<colortype::RGB16>(&[Page::plain()], |v| (v * 65535.0) as u16), Encoding::Srgb, 2e-5),
        (write::<colortype::RGB32Float>(&[Page::plain()], |v| v as f32), Encoding::Linear, 1e-6),
        (write::<colortype::RGB64Float>(&[Page::plain()], |v| v), Encoding::Linear, 1e-6),
    ];
    for (bytes, encoding, tolerance) in cases {
        let decoded = read(&bytes).expect("read");
        assert_eq!((decoded.encoding, decoded.warnings.len()), (encoding, 0));
        assert_values(&decoded, tolerance);
    }
}

#[test]
fn integers_without_a_known_white_are_refused_and_not_called_damaged() {
    let signed = {
        let mut bytes = Vec::new();
        let mut encoder = TiffEncoder::new(Cursor::new(&mut bytes)).expect("encoder");
        let samples = vec![100_i16; (WIDTH * HEIGHT) as usize];
        encoder.write_image::<colortype::GrayI16>(WIDTH, HEIGHT, &samples).expect("write");
        bytes
    };
    let cases = [
        (signed, "signed integers"),
        (write::<colortype::RGB32>(&[Page::plain()], |v| (v * 4_294_967_295.0) as u32), "32-bit integers"),
        (write::<colortype::RGB64>(&[Page::plain()], |v| (v * 1.8e19) as u64), "64-bit integers"),
    ];
    for (bytes, word) in cases {
        let error = read(&bytes).err().expect("refused");
        assert!(error.contains(word) && !error.contains("damaged"), "{error}");
    }
}

#[test]
fn the_page_at_full_resolution_is_taken_wherever_it_stands() {
    let small = || Page { width: 32, height: 32, extra: vec![(tag::NEW_SUBFILE_TYPE, vec![1])] };
    let large_mask = Page { width: 80, height: 80, extra: vec![(tag::NEW_SUBFILE_TYPE, vec![4])] };
    let full = || Page::with(tag::NEW_SUBFILE_TYPE, 0);
    for pages in [vec![small(), full()], vec![full(), small()], vec![small(), large_mask, full()]] {
        let decoded = read(&write::<colortype::RGB8>(&pages, eight)).expect("read");
        assert_eq!((decoded.width, decoded.height, decoded.warnings.len()), (WIDTH, HEIGHT, 0));
        assert_values(&decoded, 0.002);
    }
    let decoded = read(&write::<colortype::RGB8>(&[small()], eight)).expect("read");
    assert!(decoded.warnings[0].contains("only reduced pictures"));
    let larger = Page { width: 64, height: 50, extra: Vec::new() };
    let decoded = read(&write::<colortype::RGB8>(&[full(), larger, full()], eight)).expect("read");
    assert_eq!(decoded.width, 64);
    assert!(decoded.warnings[0].contains("3 pictures"));
}

#[test]
fn raw_photos_are_named_and_never_read() {
    let cases = [
        (tag::DNG_VERSION, 1, "phone.dng", "(DNG)"),
        (tag::DNG_VERSION, 1, "phone.tif", "(DNG)"),
        (tag::COMPRESSION, 34713, "a.nef", "(NEF)"),
        (tag::COMPRESSION, 32767, "a.arw", "(ARW)"),
    ];
    for (tag, value, name, word) in cases {
        let plain = write::<colortype::RGB8>(&[Page::with(tag::SUBFILE_TYPE, 1)], eight);
        // The field's tag and value in place: a byte order and a type that the encoder also writes.
        let mut bytes = plain;
        let wanted = tag::SUBFILE_TYPE.to_le_bytes();
        let at = bytes.windows(4).rposition(|w| w[..2] == wanted && w[2..] == [4, 0]).expect("the field");
        bytes[at..at + 2].copy_from_slice(&tag.to_le_bytes());
        bytes[at + 8..at + 12].copy_from_slice(&u32::to_le_bytes(value));
        if tag == tag::COMPRESSION {
            // The encoder's own field gives way.
            let own = bytes.windows(4).rposition(|w| w == [3, 1, 3, 0]).expect("the field");
            bytes[own..own + 2].copy_from_slice(&tag::SUBFILE_TYPE.to_le_bytes());
        }
        let error = read_named(name, &bytes).err().expect("refused");
        assert!(
            error.contains("raw photo") && error.contains(word) && error.contains("export it"),
            "{error}"
        );
    }
}

#[test]
fn big_tiffs_are_read() {
    let mut bytes = Vec::new();
    let mut encoder = TiffEncoder::new_big(Cursor::new(&mut bytes)).expect("encoder");
    let samples: Vec<_> = values(WIDTH, HEIGHT).into_iter().map(eight).collect();
    encoder.write_image::<colortype::RGB8>(WIDTH, HEIGHT, &samples).expect("write");
    assert_values(&read(&bytes).expect("read"), 0.002);
}

#[test]
fn the_orientation_is_the_pages_own() {
    let bytes = write::<colortype::RGB8>(&[Page::with(tag::ORIENTATION, 6)], eight);
    assert_eq!(read(&bytes).expect("read").exif.orientation, Some(6));
}

#[test]
fn a_cut_file_is_refused() {
    let bytes = write::<colortype::RGB8>(&[Page::plain()], eight);
    for end in (0..bytes.len()).step_by(97) {
        assert!(read(&bytes[..end]).is_err(), "cut to {end} of {}", bytes.len());
    }
}

#[test]
fn planes_and_tiles_find_their_places() {
    let shape = Shape { width: 3, height: 2, channels: 2, planes: 2 };
    let mut samples = vec![0_u8; 12];
    for (channel, piece) in [(0, [1_u8, 2, 3, 4, 5, 6]), (1, [11, 12, 13, 14, 15, 16])] {
        let place = Place { x: 0, y: 0, width: 3, height: 2, channels: 1, channel };
        scatter(&shape, place, &piece, &mut samples, |v| v);
    }
    assert_eq!(samples, [1, 11, 2, 12, 3, 13, 4, 14, 5, 15, 6, 16]);
    let place = Place { x: 2, y: 1, width: 1, height: 1, channels: 2, channel: 0 };
    scatter(&shape, place, &[8_u8, 9], &mut samples, |v| v);
    assert_eq!(samples[10..], [8, 9]);
}
