//! What kind of file it is, by its content; files that are something else get words and advice of their own.
use super::FORMATS_HELP;
use crate::failure::Failure;
use std::path::Path;

/// The containers that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Container {
    Png,
    Jpeg,
    Tiff,
    WebP,
}

/// Bytes of a file's head that [`sniff`] looks at.
pub(super) const HEAD: usize = 64;

pub(super) const RAW_HELP: &str = "export it from the camera's or phone's program as JPEG or 16-bit TIFF";
const HEIF_HELP: &str =
    "convert it to JPEG, or let the phone take JPEG (iPhone: Settings, Camera, Formats, Most Compatible)";
const CONVERT_HELP: &str = "save it as PNG, JPEG or TIFF";
const VIDEO_HELP: &str = "take a photo, or save one frame as PNG";

/// The container of the file that starts with `head`.
pub(super) fn sniff(path: &Path, head: &[u8]) -> Result<Container, Failure> {
    let starts = |magic: &[u8]| head.starts_with(magic);
    let at = |place: usize, magic: &[u8]| head.get(place..).is_some_and(|rest| rest.starts_with(magic));
    let refuse = |what: &str, help: &str| {
        Err(Failure::new(path, format!("is {what}, which Flashmat does not read"), help))
    };
    // Raw formats that look like a TIFF come before it.
    if at(8, b"CR\x02\0") {
        return refuse("a raw photo (CR2)", RAW_HELP);
    }
    for (magic, name) in [
        (&b"IIU\0"[..], "RW2"),
        (b"IIRO", "ORF"),
        (b"IIRS", "ORF"),
        (b"MMOR", "ORF"),
        (b"FUJIFILMCCD-RAW", "RAF"),
        (b"FOVb", "X3F"),
        (b"\0MRM", "MRW"),
    ] {
        if starts(magic) {
            return refuse(&format!("a raw photo ({name})"), RAW_HELP);
        }
    }
    if starts(b"\x89PNG\r\n\x1a\n") {
        return Ok(Container::Png);
    }
    if starts(b"\xff\xd8\xff") {
        return Ok(Container::Jpeg);
    }
    if [b"II\x2a\0", b"MM\0\x2a", b"II\x2b\0", b"MM\0\x2b"].iter().any(|magic| starts(*magic)) {
        return Ok(Container::Tiff);
    }
    if starts(b"RIFF") && at(8, b"WEBP") {
        return Ok(Container::WebP);
    }
    if at(4, b"ftyp") {
        let (what, help) = brand(head);
        return refuse(what, help);
    }
    for (magic, what, help) in [
        (&b"\xff\x0a"[..], "a JPEG XL picture", CONVERT_HELP),
        (b"\0\0\0\x0cJXL ", "a JPEG XL picture", CONVERT_HELP),
        (b"\0\0\0\x0cjP  ", "a JPEG 2000 picture", CONVERT_HELP),
        (b"\xff\x4f\xff\x51", "a JPEG 2000 picture", CONVERT_HELP),
        (b"\xff\xd8", "a broken JPEG", "copy it from the phone again"),
        (b"II\xbc", "a JPEG XR picture", CONVERT_HELP),
        (b"GIF8", "a GIF picture", CONVERT_HELP),
        (b"BM", "a BMP picture", CONVERT_HELP),
        (b"8BPS", "a Photoshop document", CONVERT_HELP),
        (b"\x76\x2f\x31\x01", "an OpenEXR picture", "save it as a TIFF with 32-bit float samples"),
        (b"#?RADIANCE", "a Radiance picture", "save it as a TIFF with 32-bit float samples"),
        (b"\0\0\x01\0", "an icon", CONVERT_HELP),
        (b"gimp xcf", "a GIMP document", CONVERT_HELP),
        (b"qoif", "a QOI picture", CONVERT_HELP),
        (b"DDS ", "a DDS texture", CONVERT_HELP),
        (b"%PDF", "a PDF document", "save its picture as PNG, JPEG or TIFF"),
        (b"<svg", "an SVG drawing", FORMATS_HELP),
        (b"\x1a\x45\xdf\xa3", "a video", VIDEO_HELP),
    ] {
        if starts(magic) {
            return refuse(what, help);
        }
    }
    Err(Failure::new(path, "is not a picture that Flashmat reads", FORMATS_HELP))
}

/// What an ISO media file holds: by its major brand, then by the compatible ones.
fn brand(head: &[u8]) -> (&'static str, &'static str) {
    let length = head.first_chunk::<4>().map_or(0, |b| u32::from_be_bytes(*b) as usize);
    let brands = head.get(8..length.min(head.len())).unwrap_or(&[]);
    // Four bytes of version lie between the major brand and the others.
    let all = brands.chunks_exact(4).enumerate().filter(|(i, _)| *i != 1).map(|(_, brand)| brand);
    for brand in all {
        match brand {
            b"crx " => return ("a raw photo (CR3)", RAW_HELP),
            b"avif" | b"avis" | b"avio" | b"MA1A" | b"MA1B" => {
                return ("an AVIF picture (of the HEIF family)", HEIF_HELP);
            }
            b"heic" | b"heix" | b"heim" | b"heis" | b"hevc" | b"hevx" | b"hevm" | b"hevs" | b"mif1"
            | b"mif2" | b"mif3" | b"msf1" | b"miaf" | b"avci" | b"avcs" | b"vvic" | b"vvis" | b"evbi"
            | b"j2ki" | b"j2is" | b"jpeg" | b"jpgs" | b"MiHB" | b"MiHE" | b"MiHA" | b"unif" => {
                return ("an HEIF picture (HEIC)", HEIF_HELP);
            }
            _ => {}
        }
    }
    ("a video or another media file", VIDEO_HELP)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(head: &[u8]) -> String {
        sniff(Path::new("x"), head).expect_err("refused").to_string()
    }

    #[test]
    fn the_four_containers_are_told_by_their_first_bytes() {
        let cases: [(&[u8], Container); 6] = [
            (b"\x89PNG\r\n\x1a\n....", Container::Png),
            (b"\xff\xd8\xff\xe1....", Container::Jpeg),
            (b"II\x2a\0\x08\0\0\0........", Container::Tiff),
            (b"MM\0\x2a\0\0\0\x08", Container::Tiff),
            (b"MM\0\x2b\0\x08\0\0", Container::Tiff),
            (b"RIFF\0\0\0\0WEBPVP8 ", Container::WebP),
        ];
        for (head, wanted) in cases {
            assert_eq!(sniff(Path::new("x"), head).expect("read"), wanted);
        }
    }

    #[test]
    fn every_brand_of_heif_gets_its_advice_and_a_video_another() {
        for brand in ["heic", "heix", "heim", "heis", "hevc", "hevx", "mif1", "msf1", "avif", "avis"] {
            let head = [&b"\0\0\0\x18ftyp"[..], brand.as_bytes(), b"\0\0\0\0mif1heic"].concat();
            let text = word(&head);
            assert!(text.contains("HEIF") && text.contains("Most Compatible"), "{brand}: {text}");
        }
        // Known only by a compatible brand.
        assert!(word(b"\0\0\0\x18ftypXXXX\0\0\0\0mif1heic").contains("HEIC"));
        assert!(word(b"\0\0\0\x18ftypcrx \0\0\0\x01crx isom").contains("raw photo (CR3)"));
        assert!(word(b"\0\0\0\x14ftypqt  \0\0\0\0qt  ").contains("video"));
        assert!(word(b"\0\0\0\x08ftyp").contains("video"));
    }

    #[test]
    fn raw_photos_and_other_formats_are_named() {
        assert!(word(b"II\x2a\0\x10\0\0\0CR\x02\0").contains("raw photo (CR2)"));
        assert!(word(b"IIU\0\x08\0\0\0").contains("RW2"));
        assert!(word(b"FUJIFILMCCD-RAW 0201").contains("RAF"));
        for (head, name) in
            [(&b"GIF89a"[..], "GIF"), (b"BM....", "BMP"), (b"\xff\x0a", "JPEG XL"), (b"8BPS", "Photoshop")]
        {
            assert!(word(head).contains(name));
        }
        assert!(word(b"hello").contains("not a picture"));
        assert!(word(b"").contains("not a picture"));
    }
}
