use super::*;

fn resolved(pixels: Pixels, tags: &Tags) -> (Pixels, Encoding, Vec<String>) {
    resolved_with(pixels, tags, exif::Colours::Srgb)
}

fn resolved_with(mut pixels: Pixels, tags: &Tags, exif: exif::Colours) -> (Pixels, Encoding, Vec<String>) {
    let mut warnings = Vec::new();
    let encoding = resolve(&mut pixels, tags, exif, Encoding::Srgb, &mut warnings);
    (pixels, encoding, warnings)
}

fn icc(profile: &ColorProfile) -> Tags {
    Tags { icc: Some(Icc::Whole(profile.encode().expect("profile"))), ..Tags::default() }
}

/// The codes of `linear` sRGB colours in a profile of colorants and one exponent.
fn encoded(linear: &[[f64; 3]], profile: &ColorProfile, gamma: f64) -> Vec<f64> {
    let matrix = ColorProfile::new_srgb().transform_matrix(profile);
    let values = linear.iter().flat_map(|rgb| {
        matrix
            .v
            .map(|row| row.iter().zip(rgb).map(|(a, b)| a * b).sum::<f64>().clamp(0.0, 1.0).powf(1.0 / gamma))
    });
    values.collect()
}

fn colours() -> Vec<[f64; 3]> {
    let steps = [0.02, 0.1, 0.3, 0.6, 0.9];
    steps.iter().flat_map(|&r| steps.iter().flat_map(move |&g| steps.map(|b| [r, g, b]))).collect()
}

fn srgb_codes(linear: &[[f64; 3]]) -> Vec<f64> {
    linear.iter().flatten().map(|&v| f64::from(linear_to_srgb(v as f32)) * 255.0).collect()
}

/// Largest difference in codes of 255 from what the colours are in sRGB.
fn worst(pixels: &Pixels, encoding: Encoding, wanted: &[f64]) -> f64 {
    let decode = |v: f64| match encoding {
        Encoding::Linear => f64::from(linear_to_srgb(v as f32)) * 255.0,
        _ => v * 255.0,
    };
    let values: Vec<f64> = match pixels {
        Pixels::Rgb8(p) => p.iter().map(|&v| decode(f64::from(v) / 255.0)).collect(),
        Pixels::Rgb16(p) => p.iter().map(|&v| decode(f64::from(v) / 65535.0)).collect(),
        Pixels::RgbF32(p) => p.iter().map(|&v| decode(v.into())).collect(),
    };
    assert_eq!(values.len(), wanted.len());
    values.iter().zip(wanted).map(|(v, w)| (v - w).abs()).fold(0.0, f64::max)
}

fn spaces() -> Vec<(&'static str, ColorProfile, f64)> {
    let with = |mut profile: ColorProfile, gamma: f32| {
        set_curve(&mut profile, curve_from_gamma(gamma));
        profile
    };
    vec![
        ("Adobe RGB", ColorProfile::new_adobe_rgb(), 2.199_218_75),
        ("ProPhoto", with(ColorProfile::new_pro_photo_rgb(), 1.8), 1.8),
        ("Rec. 2020", with(ColorProfile::new_bt2020(), 2.4), 2.4),
        ("gamma 1.8", with(ColorProfile::new_srgb(), 1.8), 1.8),
        ("linear Rec. 2020", with(ColorProfile::new_bt2020(), 1.0), 1.0),
    ]
}

#[test]
fn matrix_profiles_count_by_content_in_every_depth() {
    let linear = colours();
    let wanted = srgb_codes(&linear);
    for (name, profile, gamma) in spaces() {
        let codes = encoded(&linear, &profile, gamma);
        let eight = Pixels::Rgb8(codes.iter().map(|v| (v * 255.0).round() as u8).collect());
        let sixteen = Pixels::Rgb16(codes.iter().map(|v| (v * 65535.0).round() as u16).collect());
        let float = Pixels::RgbF32(codes.iter().map(|&v| v as f32).collect());
        for (depth, pixels, limit) in [("8", eight, 6.0), ("16", sixteen, 0.6), ("float", float, 0.6)] {
            let (pixels, encoding, warnings) = resolved(pixels, &icc(&profile));
            assert_eq!(warnings, [""; 0], "{name}");
            // 8-bit codes are coarse where the profile's curve is flatter than sRGB's.
            let limit = if gamma == 1.0 && depth == "8" { 20.0 } else { limit };
            let off = worst(&pixels, encoding, &wanted);
            assert!(off < limit, "{name}, {depth}: off by {off}");
        }
    }
}

#[test]
fn profiles_of_the_cores_own_encodings_leave_the_pixels_alone() {
    let mut linear = ColorProfile::new_srgb();
    set_curve(&mut linear, curve_from_gamma(1.0));
    let mut named = ColorProfile::new_srgb();
    named.description = Some(ProfileText::PlainString("sRGB, converted from Display P3".to_owned()));
    let cases = [
        (ColorProfile::new_srgb(), Encoding::Srgb),
        (named, Encoding::Srgb),
        (ColorProfile::new_display_p3(), Encoding::DisplayP3),
        (linear, Encoding::Linear),
    ];
    for (profile, wanted) in cases {
        let (pixels, encoding, warnings) =
            resolved(Pixels::Rgb8(vec![1, 2, 3, 99, 100, 255]), &icc(&profile));
        assert!(matches!(pixels, Pixels::Rgb8(p) if p == [1, 2, 3, 99, 100, 255]));
        assert_eq!((encoding, warnings.len()), (wanted, 0));
    }
}

#[test]
fn a_colour_outside_srgb_does_not_count_as_clipped_and_a_clipped_one_stays_so() {
    // The green of Rec. 2020, which sRGB does not hold, and one that the camera had clipped.
    let (pixels, _, _) =
        resolved(Pixels::Rgb8(vec![10, 250, 10, 255, 255, 255]), &icc(&ColorProfile::new_bt2020()));
    let Pixels::Rgb8(p) = pixels else { panic!("8 bits") };
    assert_eq!(p[1], CLIPPED_BYTE - 1);
    assert_eq!(p[3..], [255; 3]);
}

#[test]
fn the_order_of_the_png_specification_holds() {
    let adobe = ColorProfile::new_adobe_rgb().encode().expect("profile");
    let p3 = Cicp { primaries: 12, transfer: 13, matrix: 0, full_range: true };
    let all = Tags {
        cicp: Some(p3),
        icc: Some(Icc::Whole(adobe)),
        srgb: true,
        gamma: Some(1.0),
        ..Tags::default()
    };
    let grey = || Pixels::Rgb8(vec![100, 50, 25]);
    assert_eq!(resolved(grey(), &all).1, Encoding::DisplayP3);
    let (pixels, encoding, _) = resolved(grey(), &Tags { cicp: None, ..all.clone() });
    assert!(
        encoding == Encoding::Srgb && matches!(pixels, Pixels::Rgb8(p) if p != [100, 50, 25]),
        "by the profile"
    );
    let (pixels, encoding, _) = resolved(grey(), &Tags { cicp: None, icc: None, ..all.clone() });
    assert!(encoding == Encoding::Srgb && matches!(pixels, Pixels::Rgb8(p) if p == [100, 50, 25]), "by sRGB");
    let gamma = Tags { cicp: None, icc: None, srgb: false, ..all };
    assert_eq!(resolved(grey(), &gamma).1, Encoding::Linear);
    // EXIF comes last.
    let exif = exif::Colours::AdobeRgb;
    assert_eq!(resolved_with(grey(), &gamma, exif).1, Encoding::Linear);
    let (pixels, ..) = resolved_with(grey(), &Tags::default(), exif);
    assert!(matches!(pixels, Pixels::Rgb8(p) if p != [100, 50, 25]));
}

#[test]
fn gamma_and_chromaticities_count() {
    let linear = colours();
    let wanted = srgb_codes(&linear);
    let adobe = [[0.3127, 0.3290], [0.64, 0.33], [0.21, 0.71], [0.15, 0.06]];
    let codes = encoded(&linear, &ColorProfile::new_adobe_rgb(), 1.8);
    let pixels = Pixels::Rgb16(codes.iter().map(|v| (v * 65535.0).round() as u16).collect());
    let tags = Tags { gamma: Some(1.0 / 1.8), chromaticities: Some(adobe), ..Tags::default() };
    let (pixels, encoding, warnings) = resolved(pixels, &tags);
    assert_eq!(warnings, [""; 0]);
    let off = worst(&pixels, encoding, &wanted);
    assert!(off < 1.0, "off by {off}");
    // What programs write for sRGB is sRGB; chromaticities that make no sense do not count.
    let srgb = [[0.3127, 0.3290], [0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];
    for chromaticities in [None, Some(srgb), Some([[0.0; 2]; 4])] {
        let tags = Tags { gamma: Some(0.454_55), chromaticities, ..Tags::default() };
        assert_eq!(resolved(Pixels::Rgb8(vec![1, 2, 3]), &tags).1, Encoding::Srgb);
    }
}

#[test]
fn what_cannot_be_honoured_is_a_warning_that_names_it() {
    let told = |tags: &Tags, exif| {
        let (pixels, encoding, warnings) = resolved_with(Pixels::Rgb8(vec![9, 99, 199]), tags, exif);
        assert!(matches!(pixels, Pixels::Rgb8(p) if p == [9, 99, 199]));
        assert_eq!((encoding, warnings.len()), (Encoding::Srgb, 1), "{warnings:?}");
        warnings.concat()
    };
    let srgb = exif::Colours::Srgb;
    let mut adobe = ColorProfile::new_adobe_rgb();
    adobe.description = Some(ProfileText::PlainString("My printer".to_owned()));
    let ink = Tags { ink: true, ..icc(&adobe) };
    assert!(told(&ink, srgb).contains("\"My printer\" is not honoured (the picture is CMYK)"));
    let grey = icc(&ColorProfile::new_gray_with_gamma(2.2));
    assert!(told(&grey, srgb).contains("grey"));
    let broken = Tags { icc: Some(Icc::Whole(b"no profile".to_vec())), ..Tags::default() };
    assert!(told(&broken, srgb).contains("broken"));
    let parts = Tags { icc: Some(Icc::Broken), ..Tags::default() };
    assert!(told(&parts, srgb).contains("parts of it are missing"));
    for (transfer, word) in [(16, "PQ"), (18, "HLG"), (2, "unknown curve")] {
        let cicp = Cicp { primaries: 9, transfer, matrix: 0, full_range: true };
        assert!(told(&Tags { cicp: Some(cicp), ..Tags::default() }, srgb).contains(word));
    }
    let narrow = Cicp { primaries: 1, transfer: 13, matrix: 0, full_range: false };
    assert!(told(&Tags { cicp: Some(narrow), ..Tags::default() }, srgb).contains("video range"));
    assert!(told(&Tags::default(), exif::Colours::Other(65535)).contains("space 65535"));
}

#[test]
fn a_grey_profile_counts_for_a_grey_picture() {
    let tags = Tags { grey: true, ..icc(&ColorProfile::new_gray_with_gamma(1.0)) };
    assert_eq!(resolved(Pixels::Rgb8(vec![1, 1, 1]), &tags).1, Encoding::Linear);
}
