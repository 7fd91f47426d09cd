//! What a photo's values mean: its colour profile, by content, or what stands in place of one.
//!
//! sRGB, linear sRGB and Display P3 go to the core as they are. Everything else is taken to sRGB here, in place and in
//! the photo's own depth, by `moxcms`; floats are taken to linear light.
use super::{Pixels, exif};
use flashmat_core::frame::Encoding;
use flashmat_core::frame::transfer::linear_to_srgb;
use moxcms::{
    Chromaticity, CicpColorPrimaries, CicpProfile, ColorPrimaries, ColorProfile, DataColorSpace, Layout,
    MatrixCoefficients, ProfileText, RenderingIntent, ToneReprCurve, TransferCharacteristics,
    TransformExecutor, TransformOptions, XyY, curve_from_gamma,
};

/// Largest difference of a colorant (XYZ, Y = 1) from sRGB's or Display P3's that still counts as theirs.
const COLORANT_TOLERANCE: f64 = 0.002;
/// Largest difference of a curve from the sRGB curve or the straight line that still counts as theirs, in sRGB codes
/// of 255.
const CURVE_TOLERANCE: f32 = 0.6;
/// Codes from here on are clipped for the core.
const CLIPPED_BYTE: u8 = 254;
const CLIPPED_WIDE: u16 = 254 * 257;
/// gAMA of sRGB pictures, which programs write for want of a better value.
const SRGB_GAMMA: f32 = 0.454_55;

/// An embedded ICC profile.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Icc {
    Whole(Vec<u8>),
    /// Parts of it are missing.
    Broken,
}

/// A PNG cICP chunk: code points of ITU-T H.273.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cicp {
    pub(super) primaries: u8,
    pub(super) transfer: u8,
    pub(super) matrix: u8,
    pub(super) full_range: bool,
}

/// All that a file says of its colours.
#[derive(Clone, Debug, Default)]
pub(super) struct Tags {
    pub(super) cicp: Option<Cicp>,
    pub(super) icc: Option<Icc>,
    pub(super) srgb: bool,
    /// PNG gAMA: the exponent that the values were encoded with, as 0.45.
    pub(super) gamma: Option<f32>,
    /// PNG cHRM: x, y of white, red, green, blue.
    pub(super) chromaticities: Option<[[f32; 2]; 4]>,
    /// The pixels were grey.
    pub(super) grey: bool,
    /// The pixels were CMYK and have been taken to RGB without a profile.
    pub(super) ink: bool,
}

/// What the values mean.
enum Meaning {
    Known(Encoding),
    Profile(Box<ColorProfile>),
}

/// Gives `pixels` a meaning that the core knows, by the file's tags in the order of the PNG specification (cICP, iCCP,
/// sRGB, gAMA and cHRM; then EXIF), else `default`. What cannot be honoured goes to `warnings` by name.
pub(super) fn resolve(
    pixels: &mut Pixels,
    tags: &Tags,
    exif: exif::Colours,
    default: Encoding,
    warnings: &mut Vec<String>,
) -> Encoding {
    let meaning = meaning(tags, exif, warnings).unwrap_or(Meaning::Known(default));
    match meaning {
        Meaning::Known(encoding) => encoding,
        Meaning::Profile(profile) => apply(pixels, &profile).unwrap_or_else(|error| {
            warnings.push(not_honoured(&format!("profile {}", name(&profile)), &error));
            default
        }),
    }
}

fn not_honoured(what: &str, why: &str) -> String {
    format!("its colour {what} is not honoured ({why}): its values are taken as sRGB")
}

fn meaning(tags: &Tags, exif: exif::Colours, warnings: &mut Vec<String>) -> Option<Meaning> {
    if let Some(cicp) = tags.cicp {
        match by_cicp(cicp) {
            Ok(profile) => return Some(classified(profile)),
            Err(why) => {
                let what = format!("code cICP {}/{}/{}", cicp.primaries, cicp.transfer, cicp.matrix);
                warnings.push(not_honoured(&what, why));
            }
        }
    }
    match &tags.icc {
        Some(Icc::Whole(bytes)) => match by_icc(bytes, tags) {
            Ok(profile) => return Some(classified(profile)),
            Err((name, why)) => warnings.push(not_honoured(&format!("profile {name}"), &why)),
        },
        Some(Icc::Broken) => warnings.push(not_honoured("profile", "parts of it are missing")),
        None => {}
    }
    if tags.srgb {
        return Some(Meaning::Known(Encoding::Srgb));
    }
    if tags.gamma.is_some() || tags.chromaticities.is_some() {
        return Some(by_gamma(tags.gamma, tags.chromaticities));
    }
    match exif {
        exif::Colours::Srgb => None,
        exif::Colours::AdobeRgb => Some(classified(ColorProfile::new_adobe_rgb())),
        // Editors write 65535 beside every profile; without one nothing is known.
        exif::Colours::Other(65535) if tags.icc.is_some() => None,
        exif::Colours::Other(number) => {
            warnings.push(not_honoured(
                &format!("space {number} of its EXIF"),
                "uncalibrated, without a profile",
            ));
            None
        }
    }
}

fn by_cicp(cicp: Cicp) -> Result<ColorProfile, &'static str> {
    if !cicp.full_range {
        return Err("video range");
    }
    if cicp.matrix != 0 {
        return Err("not RGB");
    }
    let primaries = CicpColorPrimaries::try_from(cicp.primaries).map_err(|_| "unknown primaries")?;
    if ColorPrimaries::try_from(primaries).is_err() {
        return Err("unknown primaries");
    }
    let transfer = match cicp.transfer {
        16 => return Err("HDR, PQ"),
        18 => return Err("HDR, HLG"),
        0 | 2 | 3 => return Err("unknown curve"),
        code => TransferCharacteristics::try_from(code).map_err(|_| "unknown curve")?,
    };
    let mut profile = ColorProfile::new_srgb();
    profile.update_rgb_colorimetry_from_cicp(CicpProfile {
        color_primaries: primaries,
        transfer_characteristics: transfer,
        matrix_coefficients: MatrixCoefficients::Identity,
        full_range: true,
    });
    Ok(profile)
}

/// The profile as one of RGB values, or its name and why it cannot be one.
fn by_icc(bytes: &[u8], tags: &Tags) -> Result<ColorProfile, (String, String)> {
    let profile = ColorProfile::new_from_slice(bytes)
        .map_err(|error| ("that it embeds".to_owned(), super::brief(&format!("it is broken: {error}"))))?;
    let refuse = |why: &str| Err((name(&profile), why.to_owned()));
    match profile.color_space {
        DataColorSpace::Rgb if tags.ink => refuse("the picture is CMYK"),
        DataColorSpace::Rgb => Ok(profile),
        DataColorSpace::Gray if tags.grey => match profile.gray_trc.clone() {
            Some(curve) => {
                let mut grey = ColorProfile::new_srgb();
                grey.description = profile.description;
                set_curve(&mut grey, curve);
                Ok(grey)
            }
            None => refuse("it has no curve"),
        },
        DataColorSpace::Gray => refuse("it is for grey pictures"),
        DataColorSpace::Cmyk => refuse("CMYK"),
        _ => refuse("it is not for RGB pictures"),
    }
}

/// gAMA and cHRM: an exponent (else the sRGB curve), primaries (else sRGB's).
fn by_gamma(gamma: Option<f32>, chromaticities: Option<[[f32; 2]; 4]>) -> Meaning {
    let mut profile = ColorProfile::new_srgb();
    if let Some([white, red, green, blue]) = chromaticities {
        let point = |[x, y]: [f32; 2]| Chromaticity::new(x, y);
        let primaries = ColorPrimaries { red: point(red), green: point(green), blue: point(blue) };
        let white = XyY::new(white[0].into(), white[1].into(), 1.0);
        profile.update_rgb_colorimetry(white, primaries);
        let sound = profile.colorant_matrix().v.iter().flatten().all(|v| v.is_finite());
        if !sound {
            profile = ColorProfile::new_srgb();
        }
    }
    if let Some(gamma) = gamma.filter(|g| (g - SRGB_GAMMA).abs() > 0.002) {
        set_curve(&mut profile, curve_from_gamma(1.0 / gamma));
    }
    classified(profile)
}

fn set_curve(profile: &mut ColorProfile, curve: ToneReprCurve) {
    profile.cicp = None;
    profile.red_trc = Some(curve.clone());
    profile.green_trc = Some(curve.clone());
    profile.blue_trc = Some(curve);
}

/// An encoding of the core where the profile is one, within the tolerances.
fn classified(profile: ColorProfile) -> Meaning {
    let has_table = profile.lut_a_to_b_perceptual.is_some() || profile.lut_a_to_b_colorimetric.is_some();
    let encoding = if has_table { None } else { known(&profile) };
    encoding.map_or_else(|| Meaning::Profile(Box::new(profile)), Meaning::Known)
}

fn known(profile: &ColorProfile) -> Option<Encoding> {
    let colorants = |other: &ColorProfile| {
        let (a, b) = (profile.colorant_matrix(), other.colorant_matrix());
        a.v.iter().flatten().zip(b.v.iter().flatten()).all(|(a, b)| (a - b).abs() <= COLORANT_TOLERANCE)
    };
    let srgb = colorants(&ColorProfile::new_srgb());
    if !srgb && !colorants(&ColorProfile::new_display_p3()) {
        return None;
    }
    let curves = [&profile.red_trc, &profile.green_trc, &profile.blue_trc];
    let mut worst = [0.0_f32; 2];
    for curve in curves {
        let curve = curve.as_ref()?.make_linear_evaluator().ok()?;
        for code in 0..=255_u8 {
            let value = f32::from(code) / 255.0;
            let linear = curve.evaluate_value(value).clamp(0.0, 1.0);
            let (is, as_srgb) = (linear_to_srgb(linear), value);
            let as_linear = linear_to_srgb(value);
            worst = [worst[0].max((is - as_srgb).abs()), worst[1].max((is - as_linear).abs())];
        }
    }
    let [from_srgb, from_linear] = worst.map(|w| w * 255.0);
    match (srgb, from_srgb <= CURVE_TOLERANCE, from_linear <= CURVE_TOLERANCE) {
        (true, true, _) => Some(Encoding::Srgb),
        (false, true, _) => Some(Encoding::DisplayP3),
        (true, _, true) => Some(Encoding::Linear),
        _ => None,
    }
}

/// The profile's own name, on one line.
fn name(profile: &ColorProfile) -> String {
    let text = match &profile.description {
        Some(ProfileText::PlainString(text)) => text.clone(),
        Some(ProfileText::Localizable(texts)) => texts.first().map(|t| t.value.clone()).unwrap_or_default(),
        Some(ProfileText::Description(text)) if !text.ascii_string.is_empty() => text.ascii_string.clone(),
        Some(ProfileText::Description(text)) => text.unicode_string.clone(),
        None => String::new(),
    };
    let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(60).collect();
    if text.is_empty() { "without a name".to_owned() } else { format!("\"{text}\"") }
}

/// Takes the pixels from `profile` to sRGB, floats to linear sRGB.
fn apply(pixels: &mut Pixels, profile: &ColorProfile) -> Result<Encoding, String> {
    let options = TransformOptions {
        rendering_intent: RenderingIntent::RelativeColorimetric,
        allow_use_cicp_transfer: false,
        ..TransformOptions::default()
    };
    let mut target = ColorProfile::new_srgb();
    let layout = Layout::Rgb;
    let failed = |error: moxcms::CmsError| super::brief(&error.to_string());
    match pixels {
        Pixels::Rgb8(samples) => {
            let transform =
                profile.create_transform_8bit(layout, &target, layout, options).map_err(failed)?;
            in_place(samples, transform.as_ref(), CLIPPED_BYTE, CLIPPED_BYTE - 1, u8::MAX)?;
            Ok(Encoding::Srgb)
        }
        Pixels::Rgb16(samples) => {
            let transform =
                profile.create_transform_16bit(layout, &target, layout, options).map_err(failed)?;
            in_place(samples, transform.as_ref(), CLIPPED_WIDE, CLIPPED_WIDE - 1, u16::MAX)?;
            Ok(Encoding::Srgb)
        }
        Pixels::RgbF32(samples) => {
            set_curve(&mut target, curve_from_gamma(1.0));
            let transform = profile.create_transform_f32(layout, &target, layout, options).map_err(failed)?;
            in_place(samples, transform.as_ref(), 1.0, 1.0_f32.next_down(), 1.0)?;
            // Colours outside sRGB.
            samples.iter_mut().for_each(|v| *v = v.max(0.0));
            Ok(Encoding::Linear)
        }
    }
}

/// Transforms a piece of the picture at a time. What the source had not clipped stays below the core's threshold,
/// though its colour lies outside sRGB, and what it had clipped stays clipped.
fn in_place<T: Copy + Default + PartialOrd>(
    samples: &mut [T],
    transform: &(dyn TransformExecutor<T> + Send + Sync),
    clipped: T,
    highest: T,
    white: T,
) -> Result<(), String> {
    const PIECE: usize = 3 * 1024;
    let mut piece = [T::default(); PIECE];
    for samples in samples.chunks_mut(PIECE) {
        let source = piece.get_mut(..samples.len()).ok_or("an inner mistake")?;
        source.copy_from_slice(samples);
        transform.transform(source, samples).map_err(|error| super::brief(&error.to_string()))?;
        for (value, source) in samples.iter_mut().zip(source.iter()) {
            *value = if *source >= clipped {
                white
            } else if *value > highest {
                highest
            } else {
                *value
            };
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
