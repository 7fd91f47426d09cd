use super::*;
use image::{Rgb, RgbImage};

/// A baseline JPEG of noise, so that every block has much data.
fn jpeg(width: u32, height: u32) -> Vec<u8> {
    let picture = RgbImage::from_fn(width, height, |x, y| {
        let n = (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503)).wrapping_mul(2_246_822_519) >> 24;
        Rgb([n as u8, (x * 3) as u8, (y * 5) as u8])
    });
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 90)
        .encode_image(&picture)
        .expect("encode");
    bytes
}

fn verdict(bytes: &[u8]) -> Verdict {
    scan::read(bytes).verdict
}

fn read(bytes: Vec<u8>) -> Result<Decoded, String> {
    decode(Path::new("x.jpg"), bytes, &mut |_, _| Ok(())).map_err(|failure| failure.to_string())
}

fn pixels(decoded: Decoded) -> Vec<u8> {
    match decoded.pixels {
        Pixels::Rgb8(pixels) => pixels,
        _ => panic!("8 bits"),
    }
}

/// Where the picture's data starts: behind the scan's header.
fn data(bytes: &[u8]) -> usize {
    let at = bytes.windows(2).position(|w| w == [0xff, 0xda]).expect("a scan");
    at + 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]))
}

#[test]
fn a_whole_file_is_whole_at_every_size() {
    for (width, height) in [(33, 32), (40, 77), (64, 64), (129, 35)] {
        let bytes = jpeg(width, height);
        let file = scan::read(&bytes);
        assert_eq!(file.verdict, Verdict::Whole, "{width} x {height}");
        assert_eq!((file.size, file.end), (Some((width, height)), bytes.len() - 2));
    }
}

#[test]
fn a_file_that_is_cut_anywhere_is_not_whole_with_or_without_an_end_marker() {
    let whole = jpeg(64, 64);
    let start = data(&whole);
    for end in (start..whole.len() - 4).step_by(7) {
        let cut = &whole[..end];
        assert!(matches!(verdict(cut), Verdict::Missing { .. }), "cut to {end} of {}", whole.len());
        assert!(matches!(verdict(&[cut, &END_OF_IMAGE].concat()), Verdict::Missing { .. }), "cut to {end}");
    }
    for end in 2..start {
        assert!(read(whole[..end].to_vec()).is_err(), "cut to {end}");
    }
}

#[test]
fn a_cut_file_is_refused_with_how_much_is_missing() {
    let whole = jpeg(256, 256);
    let half = &whole[..whole.len() / 2];
    let error = read([half, &END_OF_IMAGE].concat()).err().expect("refused");
    assert!(
        error.contains("cut short or damaged") && error.contains("% of its picture is missing"),
        "{error}"
    );
    let error = read([half, &whole].concat()).err().expect("refused");
    assert!(error.contains("another JPEG begins inside"), "{error}");
    // The last blocks of many: a warning.
    let nearly = read([&whole[..whole.len() - 12], &END_OF_IMAGE[..]].concat()).expect("nearly whole");
    assert!(nearly.warnings[0].contains("is missing"), "{:?}", nearly.warnings);
}

#[test]
fn a_missing_end_marker_and_what_cameras_append_do_not_matter() {
    let whole = jpeg(96, 64);
    let wanted = pixels(read(whole.clone()).expect("whole"));
    let bare = &whole[..whole.len() - 2];
    let trailer = [&b"SEFH"[..], &(0..=255).collect::<Vec<u8>>(), b"SEFT"].concat();
    for bytes in [
        bare.to_vec(),
        [bare, &trailer].concat(),
        [&whole[..], &trailer].concat(),
        [&whole[..], &whole].concat(),
    ] {
        let decoded = read(bytes).expect("read");
        assert_eq!(decoded.warnings, [""; 0]);
        assert_eq!(pixels(decoded), wanted);
    }
}

#[test]
fn a_zeroed_sector_is_told() {
    let whole = jpeg(256, 256);
    let start = data(&whole);
    let mut silent = 0;
    for at in (start + 100..whole.len() - 700).step_by(997) {
        let mut bytes = whole.clone();
        bytes[at..at + 512].fill(0);
        match read(bytes) {
            Ok(decoded) if decoded.warnings.is_empty() => silent += 1,
            _ => {}
        }
    }
    assert_eq!(silent, 0);
}

#[test]
fn kinds_that_are_not_decoded_are_named_and_not_called_damaged() {
    let frame = |bytes: &[u8]| bytes.windows(2).position(|w| w == [0xff, 0xc0]).expect("a frame");
    let whole = jpeg(64, 64);
    let at = frame(&whole);
    for (marker, word) in
        [(0xc9, "arithmetic"), (0xca, "arithmetic"), (0xc3, "lossless"), (0xc5, "hierarchical")]
    {
        let mut bytes = whole.clone();
        bytes[at + 1] = marker;
        let error = read(bytes).err().expect("refused");
        assert!(error.contains(word) && !error.contains("damaged"), "{error}");
    }
    let mut odd = whole.clone();
    // The second component finer than the first.
    odd[at + 11] = 0x11;
    odd[at + 14] = 0x22;
    let error = read(odd).err().expect("refused");
    assert!(error.contains("unusual chroma sampling") && !error.contains("damaged"), "{error}");
    let mut deep = whole;
    deep[at + 4] = 12;
    assert!(read(deep).err().expect("refused").contains("12 bits"));
}

#[test]
fn profile_segments_count_in_any_order_and_none_may_be_missing() {
    let part = |n: u8, text: &[u8]| [&[n, 2][..], text].concat();
    let bytes = [part(2, b"world"), part(1, b"hello ")].concat();
    assert_eq!(icc_profile(&bytes, &[0..7, 7..15]), Some(Icc::Whole(b"hello world".to_vec())));
    assert_eq!(icc_profile(&bytes, &[0..7, 7..7 + 8][..1]), Some(Icc::Broken));
    assert_eq!(icc_profile(&bytes, &[]), None);
}
