//! What a photo's EXIF says: how the camera was held, how wide it saw, what its colours mean.
//!
//! Every field that can be read counts, whatever else is broken. Lengths are in millimetres, angles in degrees.
use exif::{Context, Error, Exif, In, Reader, Tag, Value};
use flashmat_core::frame::FOCAL_35MM;

/// Half the diagonal of 24 mm x 36 mm, by which EXIF 2.3 and CIPA DCG-001 define 35 mm equivalents.
const HALF_DIAGONAL_MM: f32 = 21.633_308;
/// Angles of view over the shorter side that a photo of a material can have; others are slips of the camera or of an
/// editor.
const BELIEVABLE_DEG: std::ops::RangeInclusive<f32> = 10.0..=120.0;

/// EXIF's word on colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Colours {
    /// Not said, or sRGB.
    #[default]
    Srgb,
    /// Uncalibrated with interoperability index R03 (DCF optional colour space), or colour space 2.
    AdobeRgb,
    /// Something else, by its number.
    Other(u32),
}

/// The EXIF fields that matter here, as found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fields {
    /// 1..=8.
    pub(super) orientation: Option<u8>,
    pub(super) focal_35mm: Option<f32>,
    pub(super) focal: Option<f32>,
    /// Pixels per [`Fields::plane_unit`] on the sensor.
    pub(super) plane_resolution: Option<f32>,
    /// EXIF's number of the unit: 2 inch, 3 cm, 4 mm, 5 µm.
    pub(super) plane_unit: Option<u32>,
    /// Pixels of the picture as the camera wrote it.
    pub(super) pixels: Option<(u32, u32)>,
    pub(super) colour_space: Option<u32>,
    pub(super) adobe_by_interoperability: bool,
    /// There is EXIF, or a part of it, that cannot be read.
    pub(super) broken: bool,
}

/// Reads the first of `blocks` that says anything. A block starts with the TIFF header, or with `Exif\0\0` before it.
pub(super) fn read<'a>(blocks: impl IntoIterator<Item = &'a [u8]>) -> Fields {
    let mut broken = false;
    for block in blocks {
        let block = block.strip_prefix(b"Exif\0\0").unwrap_or(block);
        let (exif, partial) = match Reader::new().continue_on_error(true).read_raw(block.to_vec()) {
            Ok(exif) => (exif, false),
            Err(Error::PartialResult(partial)) => (partial.into_inner().0, true),
            Err(_) => {
                broken = true;
                continue;
            }
        };
        let none = exif.fields().next().is_none();
        broken |= partial;
        if !none {
            return Fields { broken, ..fields(&exif) };
        }
    }
    Fields { broken, ..Fields::default() }
}

/// A PNG text chunk "Raw profile type exif" as older programs wrote EXIF: a name, a length, hexadecimal digits.
pub(super) fn from_hex_text(text: &str) -> Option<Vec<u8>> {
    let mut lines = text.trim_start().splitn(3, '\n');
    let (_name, length, digits) = (lines.next()?, lines.next()?, lines.next()?);
    let length: usize = length.trim().parse().ok()?;
    let digits: Vec<u8> = digits.bytes().filter_map(|b| (b as char).to_digit(16)).map(|d| d as u8).collect();
    let bytes: Vec<u8> = digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]).take(length).collect();
    (!bytes.is_empty()).then_some(bytes)
}

fn fields(exif: &Exif) -> Fields {
    let number = |tag| {
        let value = &exif.get_field(tag, In::PRIMARY)?.value;
        match value {
            // Some writers give a rational where the standard says short.
            Value::Rational(v) => v.first().map(exif::Rational::to_f32),
            Value::SRational(v) => v.first().map(exif::SRational::to_f32),
            _ => value.get_uint(0).map(|v| v as f32),
        }
        .filter(|v| v.is_finite())
    };
    let count = |tag| number(tag).map(|v| v as u32);
    let interoperability = exif.get_field(Tag(Context::Interop, 1), In::PRIMARY);
    let is_r03 = interoperability.is_some_and(|field| match &field.value {
        Value::Ascii(texts) => texts.iter().any(|t| t.starts_with(b"R03")),
        Value::Undefined(bytes, _) => bytes.starts_with(b"R03"),
        _ => false,
    });
    Fields {
        orientation: number(Tag::Orientation).filter(|v| (1.0..=8.0).contains(v)).map(|v| v as u8),
        // 0 means unknown.
        focal_35mm: number(Tag::FocalLengthIn35mmFilm).filter(|mm| *mm > 0.0),
        focal: number(Tag::FocalLength).filter(|mm| *mm > 0.0),
        plane_resolution: number(Tag::FocalPlaneXResolution).filter(|r| *r > 0.0),
        plane_unit: count(Tag::FocalPlaneResolutionUnit),
        pixels: count(Tag::PixelXDimension).zip(count(Tag::PixelYDimension)),
        colour_space: count(Tag::ColorSpace),
        adobe_by_interoperability: is_r03,
        broken: false,
    }
}

impl Fields {
    /// What its colours mean.
    pub(super) fn colours(&self) -> Colours {
        match self.colour_space {
            Some(2) => Colours::AdobeRgb,
            Some(65535) | None if self.adobe_by_interoperability => Colours::AdobeRgb,
            None | Some(0 | 1) => Colours::Srgb,
            Some(other) => Colours::Other(other),
        }
    }

    /// The 35 mm-equivalent focal length of a picture of `width` x `height` pixels; what a user should know of it goes
    /// to `warnings`.
    pub(super) fn focal_35mm(&self, width: u32, height: u32, warnings: &mut Vec<String>) -> Option<f32> {
        let believable = |mm: &f32| {
            FOCAL_35MM.contains(mm) && BELIEVABLE_DEG.contains(&shorter_side_deg(*mm, width, height))
        };
        let derived = || self.equivalent_by_sensor(width, height);
        match self.focal_35mm {
            Some(mm) if believable(&mm) => Some(mm),
            Some(mm) => {
                let degrees = shorter_side_deg(mm, width, height);
                let instead = derived().filter(believable);
                let taken =
                    if instead.is_some() { "the sensor's size is used instead" } else { "give --fov" };
                warnings.push(format!(
                    "its EXIF says {mm:.0} mm (35 mm equivalent), {degrees:.1} degrees of view: not believed; {taken}"
                ));
                instead
            }
            None => derived().filter(believable),
        }
    }

    /// From the focal length and the sensor's pixels per millimetre.
    fn equivalent_by_sensor(&self, width: u32, height: u32) -> Option<f32> {
        let unit_mm = match self.plane_unit.unwrap_or(2) {
            2 => 25.4,
            3 => 10.0,
            4 => 1.0,
            5 => 0.001,
            _ => return None,
        };
        let (width, height) = self.pixels.filter(|(w, h)| *w > 0 && *h > 0).unwrap_or((width, height));
        let diagonal_mm = (width as f32).hypot(height as f32) / self.plane_resolution? * unit_mm;
        // Sensors that exist: a fifth of an inch to medium format.
        (2.0..=90.0).contains(&diagonal_mm).then_some(self.focal? * 2.0 * HALF_DIAGONAL_MM / diagonal_mm)
    }

    /// What is unknown because the EXIF is broken.
    pub(super) fn loss(&self) -> Option<String> {
        let focal = self.focal_35mm.is_some() || (self.focal.is_some() && self.plane_resolution.is_some());
        let unknown = match (self.orientation.is_some(), focal) {
            (false, false) => "orientation and field of view are unknown",
            (false, true) => "its orientation is unknown",
            (true, false) => "its field of view is unknown",
            (true, true) => return None,
        };
        self.broken.then(|| format!("its EXIF is damaged: {unknown}"))
    }
}

/// Angle over the shorter side, in degrees.
fn shorter_side_deg(focal_35mm: f32, width: u32, height: u32) -> f32 {
    let (width, height) = (width as f32, height as f32);
    2.0 * (HALF_DIAGONAL_MM / focal_35mm * width.min(height) / width.hypot(height)).atan().to_degrees()
}

#[cfg(test)]
mod tests;
