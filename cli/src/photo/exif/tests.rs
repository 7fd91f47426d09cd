use super::*;

/// A big-endian block: IFD0 and the EXIF directory with these entries (tag, type, count, four bytes).
fn block(ifd0: &[Entry], exif: &[Entry], next: u32) -> Vec<u8> {
    let mut bytes = b"MM\0\x2a\0\0\0\x08".to_vec();
    let exif_at = (8 + 2 + 12 * (ifd0.len() as u32 + 1) + 4).to_be_bytes();
    let mut ifd0 = ifd0.to_vec();
    ifd0.push((0x8769, 4, 1, exif_at));
    directory(&mut bytes, &ifd0, next);
    directory(&mut bytes, exif, 0);
    bytes
}

type Entry = (u16, u16, u32, [u8; 4]);

fn directory(bytes: &mut Vec<u8>, entries: &[Entry], next: u32) {
    bytes.extend((entries.len() as u16).to_be_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_be_bytes());
        bytes.extend(kind.to_be_bytes());
        bytes.extend(count.to_be_bytes());
        bytes.extend(value);
    }
    bytes.extend(next.to_be_bytes());
}

fn short(value: u16) -> [u8; 4] {
    let [a, b] = value.to_be_bytes();
    [a, b, 0, 0]
}

fn orientation(value: u16) -> Entry {
    (0x112, 3, 1, short(value))
}

fn focal_35mm(value: u16) -> Entry {
    (0xa405, 3, 1, short(value))
}

fn one(bytes: &[u8]) -> Fields {
    read([bytes])
}

#[test]
fn garbage_has_no_exif_and_says_so() {
    assert_eq!(read([]), Fields::default());
    for garbage in [&b"garbage that is no EXIF"[..], b"", b"Exif\0\0MM\0\x2a\0\0\xff\xff"] {
        let fields = one(garbage);
        assert!(fields.broken && fields.orientation.is_none());
        assert!(fields.loss().expect("a warning").contains("orientation and field of view are unknown"));
    }
}

#[test]
fn the_fields_are_read_with_and_without_the_prefix() {
    let bytes = block(&[orientation(6)], &[focal_35mm(52)], 0);
    for bytes in [bytes.clone(), [b"Exif\0\0", bytes.as_slice()].concat()] {
        let fields = one(&bytes);
        assert_eq!((fields.orientation, fields.focal_35mm, fields.broken), (Some(6), Some(52.0), false));
        assert_eq!(fields.loss(), None);
    }
}

#[test]
fn a_stale_pointer_or_an_overlong_value_takes_nothing_else_along() {
    let gps = (0x8825, 4, 1, 40_000_u32.to_be_bytes());
    let maker_note = (0x927c, 7, 1 << 20, 8_u32.to_be_bytes());
    let text = (0x10f, 2, 64, 0xffff_0000_u32.to_be_bytes());
    let cases = [
        block(&[orientation(6)], &[focal_35mm(52)], 40_000),
        block(&[orientation(6), gps], &[focal_35mm(52)], 0),
        block(&[text, orientation(6)], &[focal_35mm(52)], 0),
        block(&[orientation(6)], &[maker_note, focal_35mm(52)], 0),
    ];
    for bytes in cases {
        let fields = one(&bytes);
        assert_eq!((fields.orientation, fields.focal_35mm), (Some(6), Some(52.0)));
        assert!(fields.broken && fields.loss().is_none(), "nothing that matters is lost");
    }
    // Cut within the EXIF directory: the orientation is left, and a word on the rest.
    let bytes = block(&[orientation(6)], &[focal_35mm(52)], 0);
    let fields = one(&bytes[..bytes.len() - 10]);
    assert_eq!((fields.orientation, fields.focal_35mm), (Some(6), None));
    assert_eq!(fields.loss().as_deref(), Some("its EXIF is damaged: its field of view is unknown"));
}

#[test]
fn an_unreadable_block_before_a_sound_one_does_not_hide_it() {
    let sound = block(&[orientation(3)], &[focal_35mm(26)], 0);
    assert_eq!(read([&b"nonsense"[..], sound.as_slice()]).orientation, Some(3));
}

#[test]
fn orientations_outside_their_range_do_not_count() {
    assert_eq!(one(&block(&[orientation(9)], &[], 0)).orientation, None);
    assert_eq!(one(&block(&[orientation(0)], &[], 0)).orientation, None);
}

#[test]
fn colours_come_from_the_colour_space_and_the_interoperability_index() {
    let colours = |colour_space, adobe_by_interoperability| {
        Fields { colour_space, adobe_by_interoperability, ..Fields::default() }.colours()
    };
    assert_eq!(colours(Some(1), false), Colours::Srgb);
    assert_eq!(colours(None, false), Colours::Srgb);
    assert_eq!(colours(Some(65535), true), Colours::AdobeRgb);
    assert_eq!(colours(Some(2), false), Colours::AdobeRgb);
    assert_eq!(colours(Some(65535), false), Colours::Other(65535));
    // The index is read from the directory that the EXIF directory points to.
    let exif_at = 8 + 2 + 12 + 4;
    let interoperability = (exif_at + 2 + 2 * 12 + 4_u32).to_be_bytes();
    let exif = [(0xa001, 3, 1, short(65535)), (0xa005, 4, 1, interoperability)];
    let mut bytes = block(&[], &exif, 0);
    directory(&mut bytes, &[(1, 2, 4, *b"R03\0")], 0);
    assert_eq!(one(&bytes).colours(), Colours::AdobeRgb);
}

#[test]
fn an_absurd_focal_length_is_a_warning_and_not_believed() {
    for mm in [1.0, 4.0, 1000.0, 65535.0] {
        let mut warnings = Vec::new();
        let fields = Fields { focal_35mm: Some(mm), ..Fields::default() };
        assert_eq!(fields.focal_35mm(600, 450, &mut warnings), None, "{mm}");
        assert!(
            warnings.len() == 1 && warnings[0].contains("not believed; give --fov"),
            "{mm}: {warnings:?}"
        );
    }
    // A phone's real focal length in the wrong tag: a wide picture's shorter side would see a believable angle.
    for mm in [4.25, 7.9] {
        let mut warnings = Vec::new();
        let fields = Fields { focal_35mm: Some(mm), ..Fields::default() };
        assert!(BELIEVABLE_DEG.contains(&shorter_side_deg(mm, 1200, 300)));
        assert_eq!(fields.focal_35mm(1200, 300, &mut warnings), None, "{mm}");
        assert!(warnings.len() == 1 && warnings[0].contains("not believed"), "{mm}: {warnings:?}");
    }
    for mm in [8.0, 10.0, 26.0, 52.0, 120.0] {
        let mut warnings = Vec::new();
        let fields = Fields { focal_35mm: Some(mm), ..Fields::default() };
        assert_eq!(fields.focal_35mm(600, 450, &mut warnings), Some(mm));
        assert!(warnings.is_empty());
    }
}

#[test]
fn the_sensors_size_stands_in_for_the_35_mm_tag() {
    // A sensor of 36 mm x 24 mm, 6000 x 4000 pixels, resolution in inches and in centimetres: 50 mm are 50 mm.
    for (plane_unit, per_unit) in [(Some(2), 25.4), (None, 25.4), (Some(3), 10.0), (Some(4), 1.0)] {
        let fields = Fields {
            focal: Some(50.0),
            plane_resolution: Some(6000.0 / 36.0 * per_unit),
            plane_unit,
            pixels: Some((6000, 4000)),
            ..Fields::default()
        };
        // The picture has been scaled down since; its tags are the camera's.
        let mm = fields.focal_35mm(600, 400, &mut Vec::new()).expect("a focal length");
        assert!((mm - 50.0).abs() < 0.05, "{mm}");
        // It also takes over from an absurd tag.
        let mut warnings = Vec::new();
        let both = Fields { focal_35mm: Some(5000.0), ..fields };
        assert!((both.focal_35mm(600, 400, &mut warnings).expect("instead") - 50.0).abs() < 0.05);
        assert!(warnings[0].contains("the sensor's size is used instead"));
    }
    let unknown = Fields { focal: Some(50.0), ..Fields::default() };
    assert_eq!(unknown.focal_35mm(600, 400, &mut Vec::new()), None);
}

#[test]
fn a_raw_profile_text_is_its_hexadecimal_digits() {
    let text = "\nexif\n      10\n457869660000\n4d4d002a\n";
    assert_eq!(from_hex_text(text).as_deref(), Some(&b"Exif\0\0MM\0\x2a"[..]));
    assert_eq!(from_hex_text("no profile"), None);
}
