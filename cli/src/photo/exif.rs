//! What a photo's EXIF says about the camera: how it was held and how wide it saw.
use exif::{In, Tag, Value};
use std::io::Cursor;

/// The EXIF fields that matter here.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Exif {
    /// EXIF orientation 1..=8.
    pub(crate) orientation: Option<u8>,
    /// 35 mm-equivalent focal length in millimetres.
    pub(crate) focal_35mm: Option<f32>,
}

/// Reads the EXIF of a JPEG, PNG, TIFF or WebP file; anything missing or broken is absent.
pub(crate) fn read(bytes: &[u8]) -> Exif {
    let Ok(data) = exif::Reader::new().read_from_container(&mut Cursor::new(bytes)) else {
        return Exif::default();
    };
    let number = |tag| {
        let value = &data.get_field(tag, In::PRIMARY)?.value;
        match value {
            // Some writers give a rational where the standard says short.
            Value::Rational(v) => v.first().map(exif::Rational::to_f32),
            _ => value.get_uint(0).map(|v| v as f32),
        }
    };
    Exif {
        orientation: number(Tag::Orientation).filter(|v| (1.0..=8.0).contains(v)).map(|v| v as u8),
        // 0 means unknown; the rest are lenses that exist.
        focal_35mm: number(Tag::FocalLengthIn35mmFilm).filter(|mm| (5.0..=1000.0).contains(mm)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn garbage_has_no_exif() {
        assert_eq!(read(b""), Exif::default());
        assert_eq!(read(b"\xff\xd8\xff\xe1\xff\xffExif\0\0MM"), Exif::default());
    }
}
