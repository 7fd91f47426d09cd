//! What photo files say of themselves reaches the maps and the report.

use crate::common::{Folder, assert_one_complaint, capture, photo, stderr};
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageBuffer, Rgb, RgbImage};
use serde_json::Value;
use std::path::Path;

/// The maps of `photo` in its own folder of `out`, and its report.
fn captured(folder: &Folder, path: &Path, more: &[&str]) -> (RgbImage, Value) {
    let out = folder.path("out");
    let run = capture(&[path], &out, &[&["--light-scale", "0.9", "--class", "stone-spec"], more].concat());
    assert!(run.status.success(), "{}", stderr(&run));
    let maps = out.join(path.file_stem().expect("stem"));
    let albedo = image::open(maps.join("albedo.png")).expect("albedo").into_rgb8();
    let report = std::fs::read(maps.join("report.json")).expect("report");
    (albedo, serde_json::from_slice(&report).expect("json"))
}

fn warnings(report: &Value) -> Vec<String> {
    report["warnings"]
        .as_array()
        .expect("warnings")
        .iter()
        .map(|w| w.as_str().expect("text").to_owned())
        .collect()
}

/// Mean difference in codes.
fn off(a: &RgbImage, b: &RgbImage) -> f64 {
    let sum: u64 = a.iter().zip(b.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.len() as f64
}

fn linear(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// A 16-bit PNG of the photo in linear light, with `chunks` behind its header.
fn linear_png(folder: &Folder, name: &str, chunks: &[(&[u8; 4], &[u8])]) -> std::path::PathBuf {
    let tiles = photo(160, 144);
    let deep: ImageBuffer<Rgb<u16>, _> = ImageBuffer::from_fn(160, 144, |x, y| {
        Rgb(tiles.get_pixel(x, y).0.map(|v| (linear(v) * 65535.0).round() as u16))
    });
    let path = folder.path(name);
    DynamicImage::ImageRgb16(deep).save(&path).expect("save");
    let mut bytes = std::fs::read(&path).expect("bytes");
    let mut more = Vec::new();
    for (kind, data) in chunks {
        more.extend((data.len() as u32).to_be_bytes());
        let body = [&kind[..], data].concat();
        more.extend(&body);
        more.extend(crc(&body).to_be_bytes());
    }
    bytes.splice(33..33, more);
    folder.file(name, &bytes)
}

fn crc(bytes: &[u8]) -> u32 {
    let step = |crc: u32, &b: &u8| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    };
    !bytes.iter().fold(!0, step)
}

#[test]
fn a_linear_photo_gives_the_maps_of_its_srgb_twin() {
    let folder = Folder::new();
    let (twin, _) = captured(&folder, &folder.photo("twin.png"), &[]);
    let gamma = 100_000_u32.to_be_bytes();
    let tagged = linear_png(&folder, "tagged.png", &[(b"gAMA", &gamma)]);
    let (albedo, report) = captured(&folder, &tagged, &[]);
    assert!(off(&albedo, &twin) < 2.0, "off by {}", off(&albedo, &twin));
    assert_eq!(warnings(&report), [""; 0]);
    // The option stands in for a tag, and wins over one.
    let bare = linear_png(&folder, "bare.png", &[]);
    let (albedo, _) = captured(&folder, &bare, &["--encoding", "linear"]);
    assert!(off(&albedo, &twin) < 2.0);
    let (albedo, _) = captured(&folder, &tagged, &["--encoding", "srgb"]);
    assert!(off(&albedo, &twin) > 10.0, "the tag does not count");
    let wrong = linear_png(&folder, "wrong.png", &[(b"gAMA", &55_556_u32.to_be_bytes())]);
    let (albedo, _) = captured(&folder, &wrong, &["--encoding", "linear"]);
    assert!(off(&albedo, &twin) < 2.0);
}

#[test]
fn colours_that_cannot_be_honoured_are_a_warning_in_the_report() {
    let folder = Folder::new();
    let hdr = linear_png(&folder, "hdr.png", &[(b"cICP", &[9, 16, 0, 1])]);
    let (_, report) = captured(&folder, &hdr, &[]);
    let told = warnings(&report).join(" ");
    assert!(told.contains("cICP 9/16/0 is not honoured (HDR, PQ)"), "{told}");
    let (_, report) = captured(&folder, &hdr, &["--encoding", "linear"]);
    assert_eq!(warnings(&report), [""; 0], "the option leaves nothing to warn of");
}

fn jpeg(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 95).encode_image(picture).expect("encode");
    bytes
}

#[test]
fn a_cut_jpeg_is_refused_though_it_has_an_end_marker() {
    let folder = Folder::new();
    let whole = jpeg(&photo(160, 144));
    let half = &whole[..whole.len() / 2];
    let cases = [
        ("end.jpg", [half, b"\xff\xd9"].concat(), "cut short or damaged"),
        ("two.jpg", [half, &whole].concat(), "another JPEG begins inside"),
    ];
    for (name, bytes, word) in cases {
        let path = folder.file(name, &bytes);
        let run = capture(&[&path], &folder.path("out"), &[]);
        assert_one_complaint(&run, &path, &[word, "% of its picture is missing"]);
    }
}

#[test]
fn a_jpeg_without_an_end_marker_gives_the_maps_of_the_whole_file() {
    let folder = Folder::new();
    let whole = jpeg(&photo(160, 144));
    let (wanted, _) = captured(&folder, &folder.file("whole.jpg", &whole), &[]);
    let bare = folder.file("bare.jpg", &whole[..whole.len() - 2]);
    let (albedo, report) = captured(&folder, &bare, &[]);
    assert_eq!((albedo, warnings(&report).len()), (wanted, 0));
}

/// A little-endian EXIF block with an orientation, and a pointer to a next directory that is not there.
fn stale_exif(orientation: u8) -> Vec<u8> {
    let mut block = b"II\x2a\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    block.extend([orientation, 0, 0, 0]);
    block.extend(40_000_u32.to_le_bytes());
    block
}

#[test]
fn a_turned_photo_gives_the_maps_of_the_upright_one_in_every_orientation() {
    let folder = Folder::new();
    let upright = photo(160, 144);
    let plain = folder.path("upright.png");
    upright.save(&plain).expect("save");
    let (wanted, _) = captured(&folder, &plain, &[]);
    use image::imageops as ops;
    let stored: [(u8, RgbImage); 7] = [
        (2, ops::flip_horizontal(&upright)),
        (3, ops::rotate180(&upright)),
        (4, ops::flip_vertical(&upright)),
        (5, ops::rotate90(&ops::flip_vertical(&upright))),
        (6, ops::rotate270(&upright)),
        (7, ops::rotate270(&ops::flip_vertical(&upright))),
        (8, ops::rotate90(&upright)),
    ];
    for (orientation, picture) in stored {
        let name = format!("turned{orientation}.png");
        let path = folder.path(&name);
        picture.save(&path).expect("save");
        let mut bytes = std::fs::read(&path).expect("bytes");
        let body = [&b"eXIf"[..], &stale_exif(orientation)].concat();
        let mut chunk = (body.len() as u32 - 4).to_be_bytes().to_vec();
        chunk.extend(&body);
        chunk.extend(crc(&body).to_be_bytes());
        bytes.splice(33..33, chunk);
        let (albedo, report) = captured(&folder, &folder.file(&name, &bytes), &[]);
        assert!(off(&albedo, &wanted) < 0.1, "orientation {orientation}: off by {}", off(&albedo, &wanted));
        let told = warnings(&report);
        assert_eq!(told, ["its EXIF is damaged: its field of view is unknown"], "orientation {orientation}");
    }
}

/// The most memory that a capture of `path` has, in bytes.
#[cfg(target_os = "linux")]
fn peak(folder: &Folder, path: &Path) -> u64 {
    let mut command =
        crate::common::flashmat(["capture", "--quiet", "--size", "128", "--threads", "1", "--out"]);
    let mut run = command.arg(folder.path("out")).arg(path).spawn().expect("the program starts");
    let status = format!("/proc/{}/status", run.id());
    let mut most = 0;
    loop {
        // The mark never falls, and the picture is gone long before the program ends.
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let mark = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = mark.and_then(|mark| mark.trim().trim_end_matches(" kB").parse::<u64>().ok());
        most = most.max(kib.unwrap_or(0) << 10);
        if let Some(status) = run.try_wait().expect("the program runs") {
            assert!(status.success());
            return most;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_large_picture_is_in_memory_once() {
    let folder = Folder::new();
    let (width, height) = (4000, 3000);
    let bytes = u64::from(width * height * 6);
    let picture: ImageBuffer<Rgb<u16>, _> = ImageBuffer::from_fn(width, height, |x, y| {
        Rgb([20_000 + (x % 997) as u16, 30_000, (y % 9973) as u16])
    });
    let picture = DynamicImage::ImageRgb16(picture);
    let small = peak(&folder, &folder.photo("small.png"));
    for name in ["large.tiff", "large.png"] {
        let path = folder.path(name);
        picture.save(&path).expect("save");
        let large = peak(&folder, &path);
        let more = large.saturating_sub(small);
        assert!(more > bytes / 2, "{name}: nothing was measured: {large} against {small} bytes");
        assert!(
            more < bytes * 12 / 10,
            "{name}: {more} bytes more than a small photo, for a picture of {bytes}"
        );
    }
}
