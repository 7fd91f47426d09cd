//! What to say of photos that are too dark.
use crate::failure::Failure;
use crate::photo::Pixels;
use flashmat_core::Error;
use flashmat_core::frame::transfer::linear_to_srgb;
use std::path::Path;

/// A photo whose brightest parts are darker than this, linear, is very dark: code 39 of 255 and less leave too few steps
/// to tell colours and slopes apart by.
const DARK: f32 = 0.02;
/// Share of pixels that may be brighter: hot pixels of the sensor and glints.
const BRIGHTEST: f32 = 0.001;
/// Share of overexposed pixels beside which a dark photo is not just black.
const CLIPPED: f32 = 0.01;

/// A word on a photo (3 planes, linear RGB) that is very dark.
pub(crate) fn dark_warning(rgb: &[f32]) -> Option<String> {
    let (red, rest) = rgb.split_at(rgb.len() / 3);
    let (green, blue) = rest.split_at(rest.len() / 2);
    let mut values: Vec<f32> = red.iter().zip(green).zip(blue).map(|((r, g), b)| r.max(*g).max(*b)).collect();
    let at = ((1.0 - BRIGHTEST) * values.len() as f32) as usize;
    let at = at.min(values.len().checked_sub(1)?);
    let (_, &mut brightest, _) = values.select_nth_unstable_by(at, f32::total_cmp);
    let code = (255.0 * linear_to_srgb(brightest)).round();
    (brightest < DARK).then(|| {
        format!(
            "the photo is very dark (its brightest parts have code {code} of 255): take it with more exposure"
        )
    })
}

/// The failure of a photo that shows nothing where it is not overexposed.
pub(crate) fn black(path: &Path, pixels: &Pixels) -> Failure {
    let share = match pixels {
        Pixels::Rgb8(p) => clipped_share(p, |v| v == u8::MAX),
        Pixels::Rgb16(p) => clipped_share(p, |v| v == u16::MAX),
        Pixels::RgbF32(p) => clipped_share(p, |v| v >= 1.0),
    };
    if share < CLIPPED {
        return Failure::core(path, &Error::PhotoBlack);
    }
    let what = format!("{:.0} % of the photo is overexposed and the rest is all but black", 100.0 * share);
    Failure::new(path, what, "take it from straight above with the flash on, without a lamp or the sky in it")
}

fn clipped_share<T: Copy>(interleaved: &[T], is_clipped: impl Fn(T) -> bool) -> f32 {
    let clipped = interleaved.chunks_exact(3).filter(|rgb| rgb.iter().any(|&v| is_clipped(v))).count();
    clipped as f32 / (interleaved.len() / 3).max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dark_photos_are_told_from_others() {
        let mut photo = vec![0.004; 3 * 4096];
        assert!(
            dark_warning(&photo).is_some_and(|w| w.contains("code 13 of 255")),
            "{:?}",
            dark_warning(&photo)
        );
        // Hot pixels make no bright photo, a bright part does.
        photo[4096..4099].fill(1.0);
        assert!(dark_warning(&photo).is_some());
        photo[4096..4106].fill(1.0);
        assert_eq!(dark_warning(&photo), None);
        assert_eq!(dark_warning(&[]), None);
    }

    #[test]
    fn half_black_is_not_black() {
        let path = Path::new("a.png");
        let half: Vec<u8> = [[0; 3], [255; 3]].concat();
        let line = black(path, &Pixels::Rgb8(half)).to_string();
        assert!(line.contains("50 % of the photo is overexposed and the rest is all but black; "), "{line}");
        assert!(!line.contains("is black"));
        assert!(black(path, &Pixels::Rgb16(vec![0; 300])).to_string().contains("black"));
    }
}
