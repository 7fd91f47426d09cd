//! Pixels as decoders leave them, put in the order that the core reads, in the buffer they lie in.
use super::Pixels;
use std::ops::Not;

/// A sample of 8 or 16 bits or a float.
pub(super) trait Sample: Copy + Default + PartialOrd {
    /// Alpha of an opaque pixel.
    const OPAQUE: Self;
    fn pixels(samples: Vec<Self>) -> Pixels;
}

impl Sample for u8 {
    const OPAQUE: Self = Self::MAX;
    fn pixels(samples: Vec<Self>) -> Pixels {
        Pixels::Rgb8(samples)
    }
}

impl Sample for u16 {
    const OPAQUE: Self = Self::MAX;
    fn pixels(samples: Vec<Self>) -> Pixels {
        Pixels::Rgb16(samples)
    }
}

impl Sample for f32 {
    const OPAQUE: Self = 1.0;
    fn pixels(samples: Vec<Self>) -> Pixels {
        Pixels::RgbF32(samples)
    }
}

/// A buffer for `pixels` pixels of `channels` samples, with room to become RGB where it lies.
pub(super) fn buffer<T: Sample>(pixels: usize, channels: usize) -> Vec<T> {
    vec![T::default(); pixels * channels.max(3)]
}

/// Takes the first `pixels` pixels of 1 (grey), 2 (grey, alpha), 3 or 4 (RGB, alpha) samples to RGB in place; whether
/// a pixel was transparent.
pub(super) fn to_rgb<T: Sample>(samples: &mut Vec<T>, pixels: usize, channels: usize) -> bool {
    let opaque = |samples: &[T]| {
        let alphas = samples.chunks_exact(channels).take(pixels).filter_map(<[T]>::last);
        alphas.fold(true, |all, &alpha| all & (alpha >= T::OPAQUE))
    };
    let transparent = matches!(channels, 2 | 4) && opaque(samples).not();
    match channels {
        // From the end: no pixel is overwritten before it is read, since it grows towards the end.
        1 | 2 => {
            for i in (0..pixels).rev() {
                let grey = samples[i * channels];
                samples[3 * i..3 * i + 3].fill(grey);
            }
        }
        4 => {
            for i in 1..pixels {
                samples.copy_within(4 * i..4 * i + 3, 3 * i);
            }
        }
        _ => {}
    }
    samples.truncate(3 * pixels);
    transparent
}

/// Turns the picture left side right, in place.
pub(super) fn mirror(pixels: &mut Pixels, width: usize) {
    fn rows<T: Copy>(samples: &mut [T], width: usize) {
        for row in samples.chunks_exact_mut(3 * width) {
            let (pixels, _) = row.as_chunks_mut::<3>();
            pixels.reverse();
        }
    }
    match pixels {
        Pixels::Rgb8(p) => rows(p, width),
        Pixels::Rgb16(p) => rows(p, width),
        Pixels::RgbF32(p) => rows(p, width),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_channels_becomes_rgb_where_it_lies() {
        let mut grey = buffer::<u8>(3, 1);
        grey[..3].copy_from_slice(&[1, 2, 3]);
        assert!(!to_rgb(&mut grey, 3, 1));
        assert_eq!(grey, [1, 1, 1, 2, 2, 2, 3, 3, 3]);
        let mut grey_alpha = buffer::<u16>(2, 2);
        grey_alpha[..4].copy_from_slice(&[7, u16::MAX, 9, 5]);
        assert!(to_rgb(&mut grey_alpha, 2, 2));
        assert_eq!(grey_alpha, [7, 7, 7, 9, 9, 9]);
        let mut rgba = vec![1.0_f32, 2.0, 3.0, 1.0, 4.0, 5.0, 6.0, 1.0, 7.0, 8.0, 9.0, 1.0];
        assert!(!to_rgb(&mut rgba, 3, 4));
        assert_eq!(rgba, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    }

    #[test]
    fn a_mirrored_picture_keeps_its_channels_in_order() {
        let mut pixels = Pixels::Rgb8((0..12).collect());
        mirror(&mut pixels, 2);
        let Pixels::Rgb8(p) = pixels else { panic!("8 bits") };
        assert_eq!(p, [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]);
    }
}
