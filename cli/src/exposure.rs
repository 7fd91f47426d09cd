//! What to say of photos that are too dark.
use flashmat_core::frame::transfer::linear_to_srgb;

/// A photo whose brightest parts are darker than this, linear, is very dark: code 39 of 255 and less leave too few steps
/// to tell colours and slopes apart by.
const DARK: f32 = 0.02;
/// Share of pixels that may be brighter: hot pixels of the sensor and glints.
const BRIGHTEST: f32 = 0.001;

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
}
