//! What counts as overexposed, and how much of a photo is: the one definition that every binding reads.
//!
//! A *source* pixel is clipped in a channel from [`CLIPPED_BYTE`] on (16-bit: [`CLIPPED_WIDE`], float: 1), whatever its
//! encoding: decoders and YUV conversion leave saturated areas one code short of white here and there. A pixel of the
//! prepared photo is the mean of many of them (137 of a photo with 12 megapixels at 256²). It is clipped in a channel
//! where at least [`CLIPPED_AREA`] of its area is; the other channels are as good as anywhere. Where that would leave
//! nothing of the whole photo, only what is clipped all over counts: no photo is refused that has a usable value.

/// 8-bit codes from here on are clipped.
pub const CLIPPED_BYTE: u8 = 254;
/// 16-bit codes from here on are clipped.
pub const CLIPPED_WIDE: u16 = 254 * 257;
/// Share of a prepared pixel's area from which on it is clipped in a channel. Below a half its mean says more of what is
/// not clipped.
pub const CLIPPED_AREA: f32 = 0.5;
/// Share of a photo's pixels from which on it is called overexposed: highlights of good photos take up to a tenth.
pub const OVEREXPOSED: f32 = 0.1;
/// Mean linear light below which a photo is called dark: about code 25 of 255, where one code is 6 % of the light.
pub const DARK: f32 = 0.01;

/// All channels of a pixel, in [`LinearImage::clipped`](super::LinearImage::clipped).
pub const ALL_CLIPPED: u8 = 0b111;
/// A share of a box that rounding leaves short of all of it.
const WHOLE: f32 = 1.0 - 1e-5;

/// How a photo is exposed, within the square that was cropped.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposure {
    /// Share of the photo's own pixels that are clipped in red, green and blue, \[0,1\].
    pub clipped: [f32; 3],
    /// Mean linear light of what is not clipped, \[0,1\]; 0 before the pipeline has looked, and where all is clipped.
    pub brightness: f32,
}

impl Exposure {
    /// Share of the photo's own pixels that are clipped in the channel where most are, \[0,1\].
    #[must_use]
    pub fn clipped_share(&self) -> f32 {
        self.clipped.into_iter().fold(0.0, f32::max)
    }

    /// Whether so much is clipped that the maps suffer.
    #[must_use]
    pub fn is_overexposed(&self) -> bool {
        self.clipped_share() > OVEREXPOSED
    }

    /// Whether the photo is so dark that its codes are coarser than what they show.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.brightness < DARK
    }
}

/// A pixel's marks: bit c where channel c is clipped by [`CLIPPED_AREA`], bit 3 + c where it is all over.
#[inline(always)]
pub(super) fn marks(shares: [f32; 3]) -> u8 {
    let mut marks = 0;
    for (c, share) in shares.into_iter().enumerate() {
        marks |= u8::from(share >= CLIPPED_AREA) << c;
        marks |= u8::from(share >= WHOLE) << (c + 3);
    }
    marks
}

/// Leaves one bit for each channel: by area, or where that would be all, what is clipped all over.
pub(super) fn settle(marks: &mut [u8]) {
    let all = marks.iter().all(|mark| mark & ALL_CLIPPED == ALL_CLIPPED);
    for mark in marks {
        *mark = if all { *mark >> 3 } else { *mark & ALL_CLIPPED };
    }
}

/// The marks of a photo whose red and blue are exchanged.
pub(super) fn swap_red_and_blue(marks: &mut [u8]) {
    for mark in marks {
        *mark = *mark & 0o22 | (*mark & 0o11) << 2 | (*mark & 0o44) >> 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_tell_half_from_whole_and_channels_apart() {
        assert_eq!(marks([0.0, 0.49, 0.5]), 0b000_100);
        assert_eq!(marks([1.0, 0.99, 0.0]), 0b001_011);
        let mut mark = [0b001_110];
        swap_red_and_blue(&mut mark);
        assert_eq!(mark, [0b100_011]);
    }

    #[test]
    fn something_is_left_of_a_photo_that_has_something() {
        let mut some = [marks([1.0; 3]), marks([1.0, 0.9, 0.2])];
        settle(&mut some);
        assert_eq!(some, [0b111, 0b011]);
        let mut rest = [marks([1.0; 3]), marks([1.0, 0.9, 0.99])];
        settle(&mut rest);
        assert_eq!(rest, [0b111, 0b001]);
    }

    #[test]
    fn limits_are_told_by_the_worst_channel() {
        let exposure = Exposure { clipped: [0.05, 0.11, 0.0], brightness: 0.009 };
        assert!(exposure.is_overexposed() && exposure.is_dark());
        let exposure = Exposure { clipped: [0.1, 0.0, 0.0], brightness: 0.01 };
        assert!(!exposure.is_overexposed() && !exposure.is_dark());
    }
}
