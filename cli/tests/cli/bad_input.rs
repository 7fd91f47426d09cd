//! Each bad photo gives exit status 1 and one line that names it, says what is wrong and what would help.

use crate::common::{FILES, Folder, assert_one_complaint, capture, names, stderr};
use image::{Rgb, RgbImage};
use std::path::PathBuf;

fn picture(folder: &Folder, name: &str, width: u32, height: u32, colour: [u8; 3]) -> PathBuf {
    let path = folder.path(name);
    RgbImage::from_pixel(width, height, Rgb(colour)).save(&path).expect("save");
    path
}

#[test]
fn each_bad_photo_is_told_apart() {
    let folder = Folder::new();
    let jpeg = std::fs::read(folder.photo("whole.jpg")).expect("jpeg");
    let png = std::fs::read(folder.photo("whole.png")).expect("png");
    let mut flipped = png.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x10;
    let cases: Vec<(PathBuf, &[&str])> = vec![
        (folder.path("missing.jpg"), &["no such file", "check the path"]),
        (folder.path(""), &["is a folder", "name the photos in it"]),
        (folder.file("empty.jpg", b""), &["empty"]),
        (folder.file("cut.jpg", &jpeg[..jpeg.len() / 2]), &["cut short"]),
        (folder.file("cut.png", &png[..png.len() / 2]), &["cannot be decoded", "damaged"]),
        (folder.file("flipped.png", &flipped), &["cannot be decoded", "damaged"]),
        (folder.file("text.jpg", b"not a picture at all"), &["not a picture", "PNG, JPEG, TIFF or WebP"]),
        (folder.file("phone.heic", b"\0\0\0\x18ftypheic\0\0\0\0"), &["HEIF", "convert it to JPEG"]),
        (picture(&folder, "dot.png", 1, 1, [99; 3]), &["1 x 1 pixels", "at least"]),
        (picture(&folder, "line.png", 50_000, 1, [99; 3]), &["50000 x 1 pixels", "at least"]),
        (picture(&folder, "black.png", 128, 128, [0; 3]), &["black", "flash"]),
        (picture(&folder, "white.png", 128, 128, [255; 3]), &["overexposed", "less exposure"]),
    ];
    for (path, parts) in cases {
        let out = folder.path("out");
        let run = capture(&[&path], &out, &[]);
        assert_one_complaint(&run, &path, parts);
        assert_eq!(names(&out), [""; 0], "{}", path.display());
    }
}

#[test]
fn half_black_and_very_dark_photos_are_told_from_black_ones() {
    let folder = Folder::new();
    let out = folder.path("out");
    let half = folder.path("half.png");
    RgbImage::from_fn(200, 150, |x, _| Rgb([if x < 100 { 0 } else { 255 }; 3])).save(&half).expect("save");
    // The black half is data: what is not overexposed is never refused.
    let run = capture(&[&half], &out, &[]);
    assert!(run.status.success(), "{}", stderr(&run));
    assert!(
        stderr(&run).contains("half.png: warning: 50 % of the photo's pixels are overexposed"),
        "{}",
        stderr(&run)
    );
    assert!(!stderr(&run).contains("black"), "{}", stderr(&run));
    let dark = folder.path("dark.png");
    RgbImage::from_fn(200, 150, |x, y| Rgb([(5 + (x / 20 + y / 20) % 2 * 8) as u8; 3]))
        .save(&dark)
        .expect("save");
    let run = capture(&[&dark], &out, &[]);
    assert!(run.status.success(), "{}", stderr(&run));
    assert!(stderr(&run).contains("dark.png: warning: the photo is very dark"), "{}", stderr(&run));
}

#[test]
fn one_bad_photo_does_not_take_the_good_ones_along() {
    let folder = Folder::new();
    let out = folder.path("out");
    let good = ["a.png", "c.jpg"].map(|name| folder.photo(name));
    let bad = folder.file("b.png", b"\x89PNG\r\n\x1a\nnonsense");
    let run = capture(&[&good[0], &bad, &good[1]], &out, &[]);
    assert_one_complaint(&run, &bad, &["cannot be decoded"]);
    assert_eq!(names(&out), ["a", "c"]);
    for name in ["a", "c"] {
        assert_eq!(names(&out.join(name)), FILES);
    }
}

#[test]
fn a_float_photo_with_a_value_that_is_no_light_is_refused() {
    let folder = Folder::new();
    for (name, value) in [("nan.tiff", f32::NAN), ("minus.tiff", -0.5), ("infinite.tiff", f32::INFINITY)] {
        let path = folder.path(name);
        let mut pixels = vec![0.5_f32; 3 * 64 * 64];
        pixels[3 * (64 * 2 + 5)] = value;
        let picture = image::Rgb32FImage::from_raw(64, 64, pixels).expect("size");
        image::DynamicImage::ImageRgb32F(picture).save(&path).expect("save");
        let run = capture(&[&path], &folder.path("out"), &[]);
        assert_one_complaint(&run, &path, &["(5, 2)"]);
    }
}

#[test]
fn a_run_without_photos_is_a_usage_error() {
    let run = crate::common::flashmat(["capture"]).output().expect("run");
    assert_eq!(run.status.code(), Some(2));
    assert!(stderr(&run).contains("PHOTO"));
}
