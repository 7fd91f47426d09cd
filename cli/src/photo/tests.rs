use super::*;
use image::{DynamicImage, GrayAlphaImage, GrayImage, ImageBuffer, Luma, Rgb, RgbImage, Rgba};
use std::path::PathBuf;

/// A file in a folder of its own, gone with the value.
struct Temporary(PathBuf);

impl Temporary {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("flashmat-photo-{}-{name}", std::process::id()));
        fs::create_dir_all(&folder).expect("temporary folder");
        Self(folder.join(name))
    }
    fn holding(name: &str, bytes: &[u8]) -> Self {
        let file = Self::new(name);
        fs::write(&file.0, bytes).expect("write");
        file
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(self.0.parent().expect("parent"));
    }
}

fn rgb8(photo: Photo) -> Vec<u8> {
    match photo.pixels {
        Pixels::Rgb8(pixels) => pixels,
        _ => panic!("not 8 bits"),
    }
}

fn failure(file: &Temporary) -> String {
    read(&file.0).err().expect("a failure").to_string()
}

#[test]
fn grey_and_alpha_become_rgb() {
    let file = Temporary::new("grey.png");
    GrayImage::from_fn(40, 33, |x, _| Luma([x as u8])).save(&file.0).expect("save");
    let photo = read(&file.0).expect("photo");
    assert_eq!((photo.width, photo.height), (40, 33));
    assert!(photo.warnings.is_empty() && photo.focal_35mm.is_none() && photo.encoding == Encoding::Srgb);
    assert_eq!(&rgb8(photo)[..9], [0, 0, 0, 1, 1, 1, 2, 2, 2]);

    let file = Temporary::new("alpha.png");
    GrayAlphaImage::from_fn(40, 40, |x, _| image::LumaA([x as u8, 128])).save(&file.0).expect("save");
    let photo = read(&file.0).expect("photo");
    assert_eq!(photo.warnings.len(), 1);
    assert_eq!(&rgb8(photo)[3..6], [1, 1, 1]);
}

#[test]
fn sixteen_bits_stay_sixteen() {
    let file = Temporary::new("deep.png");
    let picture: ImageBuffer<Rgba<u16>, _> =
        ImageBuffer::from_fn(32, 32, |x, y| Rgba([x as u16, 258, y as u16, u16::MAX]));
    DynamicImage::ImageRgba16(picture).save(&file.0).expect("save");
    let photo = read(&file.0).expect("photo");
    assert!(photo.warnings.is_empty(), "opaque alpha needs no warning");
    match photo.pixels {
        Pixels::Rgb16(pixels) => assert_eq!(&pixels[..6], [0, 258, 0, 1, 258, 0]),
        _ => panic!("16 bits"),
    }
}

#[test]
fn every_format_is_read() {
    for name in ["a.png", "a.jpg", "a.tiff", "a.webp"] {
        let file = Temporary::new(name);
        RgbImage::from_pixel(64, 48, Rgb([200, 100, 50])).save(&file.0).expect("save");
        let photo = read(&file.0).expect(name);
        assert_eq!((photo.width, photo.height), (64, 48), "{name}");
        for (value, wanted) in rgb8(photo).iter().zip([200, 100, 50]) {
            assert!(value.abs_diff(wanted) <= 3, "{name}");
        }
    }
}

/// A JPEG with an EXIF segment: orientation and 35 mm focal length as SHORTs, big endian.
fn jpeg_with_exif(orientation: u16, focal_length: u16) -> Vec<u8> {
    // Left half bright, right half dark; 48 x 32.
    let picture =
        RgbImage::from_fn(48, 32, |x, _| if x < 24 { Rgb([250, 250, 250]) } else { Rgb([5, 5, 5]) });
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode_image(&picture)
        .expect("encode");
    let mut tiff = b"MM\0\x2a\0\0\0\x08".to_vec();
    let entry = |tag: u16, kind: u16, value: [u8; 4]| {
        let mut e = [tag.to_be_bytes(), kind.to_be_bytes()].concat();
        e.extend(1_u32.to_be_bytes());
        e.extend(value);
        e
    };
    let short = |v: u16| [v.to_be_bytes(), [0, 0]].concat().try_into().expect("4 bytes");
    tiff.extend(2_u16.to_be_bytes());
    tiff.extend(entry(0x0112, 3, short(orientation)));
    let sub_directory = 8 + 2 + 2 * 12 + 4_u32;
    tiff.extend(entry(0x8769, 4, sub_directory.to_be_bytes()));
    tiff.extend([0; 4]);
    tiff.extend(1_u16.to_be_bytes());
    tiff.extend(entry(0xa405, 3, short(focal_length)));
    tiff.extend([0; 4]);
    let mut segment = b"\xff\xe1".to_vec();
    segment.extend((tiff.len() as u16 + 8).to_be_bytes());
    segment.extend(b"Exif\0\0");
    segment.extend(tiff);
    bytes.splice(2..2, segment);
    bytes
}

#[test]
fn exif_orientation_turns_the_photo() {
    // The stored picture is mirrored or not, then turned: (bright half of the stored picture is right, rotation).
    let cases = [
        (1, false, Rotation::None),
        (2, true, Rotation::None),
        (3, false, Rotation::Cw180),
        (4, true, Rotation::Cw180),
        (5, true, Rotation::Cw270),
        (6, false, Rotation::Cw90),
        (7, true, Rotation::Cw90),
        (8, false, Rotation::Cw270),
    ];
    for (orientation, mirrored, rotation) in cases {
        let file = Temporary::holding("turned.jpg", &jpeg_with_exif(orientation, 26));
        let photo = read(&file.0).expect("photo");
        assert_eq!(
            (photo.width, photo.height, photo.rotation),
            (48, 32, rotation),
            "orientation {orientation}"
        );
        let pixels = rgb8(photo);
        let at = |x: usize| pixels[3 * (16 * 48 + x)];
        let (bright, dark) = if mirrored { (45, 2) } else { (2, 45) };
        assert!(at(bright) > 200 && at(dark) < 50, "orientation {orientation}");
    }
}

#[test]
fn the_focal_length_is_read() {
    let file = Temporary::holding("wide.jpg", &jpeg_with_exif(1, 26));
    assert_eq!(read(&file.0).expect("photo").focal_35mm, Some(26.0));
    let file = Temporary::holding("unknown.jpg", &jpeg_with_exif(1, 0));
    assert_eq!(read(&file.0).expect("photo").focal_35mm, None);
}

#[test]
fn each_bad_file_is_told_apart() {
    let whole = jpeg_with_exif(1, 26);
    assert!(failure(&Temporary::new("none.jpg")).contains("none.jpg: cannot be read: no such file"));
    assert!(failure(&Temporary::holding("e.jpg", b"")).contains("the file is empty"));
    assert!(failure(&Temporary::holding("t.jpg", &whole[..whole.len() - 30])).contains("cut short"));
    assert!(failure(&Temporary::holding("t.txt", b"hello")).contains("not a picture"));
    assert!(
        failure(&Temporary::holding("h.heic", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"))
            .contains("convert it to JPEG")
    );
    let file = Temporary::new("small.png");
    RgbImage::new(1, 1).save(&file.0).expect("save");
    assert!(failure(&file).contains("1 x 1 pixels, too few"));
    let file = Temporary::new("thin.png");
    RgbImage::new(50_000, 1).save(&file.0).expect("save");
    assert!(failure(&file).contains("50000 x 1 pixels, too few"));
    let file = Temporary::new("cut.png");
    RgbImage::from_fn(64, 64, |x, y| Rgb([(x * y) as u8, x as u8, y as u8])).save(&file.0).expect("save");
    let bytes = fs::read(&file.0).expect("bytes");
    fs::write(&file.0, &bytes[..bytes.len() / 2]).expect("write");
    assert!(failure(&file).contains("cannot be decoded"));
}

#[test]
fn a_bomb_is_refused_before_it_is_decoded() {
    // A PNG header that claims 60000 x 60000 pixels.
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
    bytes.extend(60_000_u32.to_be_bytes());
    bytes.extend(60_000_u32.to_be_bytes());
    bytes.extend([8, 2, 0, 0, 0]);
    let crc = bytes[12..].iter().fold(!0_u32, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    });
    bytes.extend((!crc).to_be_bytes());
    bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e\0\0\0\0IEND\xae\x42\x60\x82");
    let line = failure(&Temporary::holding("bomb.png", &bytes));
    assert!(line.contains("60000 x 60000 pixels, too many"), "{line}");
}
