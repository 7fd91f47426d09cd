//! YUV 4:2:0 planes and their conversion to 8-bit RGB.
//!
//! R = Y + 2(1-Kr) V, B = Y + 2(1-Kb) U, G from the luma equation Y = Kr R + Kg G + Kb B (ITU-R BT.601-7 and
//! BT.709-6), in 16-bit fixed point, rounded to the nearest 8-bit code and clamped. Each chroma sample stands for its
//! 2x2 block of luma samples (no interpolation: the average to the network's size comes after).
use crate::Error;

/// Which luma equation the camera used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum YuvMatrix {
    /// Kr = 0.299, Kb = 0.114: JPEG, Android's default.
    #[default]
    Bt601,
    /// Kr = 0.2126, Kb = 0.0722: HD video, iOS's default.
    Bt709,
}

/// Which codes black and white have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Range {
    /// Luma 0 to 255, chroma 128 ± 127.5: JPEG.
    #[default]
    Full,
    /// Luma 16 to 235, chroma 128 ± 112: video.
    Limited,
}

/// Three planes with row and pixel strides in bytes; chroma planes are half as wide and high, rounded up.
#[derive(Clone, Copy, Debug)]
pub struct YuvPlanes<'a> {
    /// Luma.
    pub y: &'a [u8],
    /// From luma row to luma row.
    pub y_row_stride: usize,
    /// From luma pixel to luma pixel (1, as a rule).
    pub y_pixel_stride: usize,
    /// Blue-difference chroma.
    pub u: &'a [u8],
    /// Red-difference chroma.
    pub v: &'a [u8],
    /// From chroma row to chroma row.
    pub uv_row_stride: usize,
    /// From chroma pixel to chroma pixel: 1 planar, 2 interleaved.
    pub uv_pixel_stride: usize,
}

impl<'a> YuvPlanes<'a> {
    pub(super) fn semi_planar(
        y: &'a [u8],
        y_stride: usize,
        uv: &'a [u8],
        uv_stride: usize,
        v_first: bool,
    ) -> Self {
        let second = uv.get(1..).unwrap_or(&[]);
        let (u, v) = if v_first { (second, uv) } else { (uv, second) };
        Self {
            y,
            y_row_stride: y_stride,
            y_pixel_stride: 1,
            u,
            v,
            uv_row_stride: uv_stride,
            uv_pixel_stride: 2,
        }
    }

    pub(super) fn check(&self, width: usize, height: usize) -> Result<(), Error> {
        let (cw, ch) = (width.div_ceil(2), height.div_ceil(2));
        check_plane(self.y.len(), width, height, self.y_row_stride, self.y_pixel_stride)?;
        check_plane(self.u.len(), cw, ch, self.uv_row_stride, self.uv_pixel_stride)?;
        check_plane(self.v.len(), cw, ch, self.uv_row_stride, self.uv_pixel_stride)
    }
}

fn check_plane(len: usize, width: usize, height: usize, row: usize, pixel: usize) -> Result<(), Error> {
    if pixel == 0 {
        return Err(Error::FrameStride { needed: 1, given: 0 });
    }
    let last = (width - 1).checked_mul(pixel).ok_or(Error::FrameTooLarge)?;
    super::pixels::check_buffer(len, last.checked_add(1).ok_or(Error::FrameTooLarge)?, height, row)
}

/// What step 0 stands for, in 8-bit codes: below the least that blue can be, BT.709 limited's 1.164 (0 - 16) - 2.112 128.
pub(super) const LOWEST: i32 = -384;
/// Steps, past the most that blue can be: 1.164 (255 - 16) + 2.112 127. A power of two.
pub(super) const STEPS: usize = 1024;

/// R, G or B rounded to whole codes, not clamped to 0..=255, from [`LOWEST`]; less than [`STEPS`].
#[inline(always)]
pub(super) fn step(luma: i32, tint: i32) -> i32 {
    (luma + tint) >> 16
}

/// YUV to RGB in 16-bit fixed point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Converter {
    luma: i32,
    black: i32,
    rv: i32,
    gu: i32,
    gv: i32,
    bu: i32,
}

impl Converter {
    pub(super) fn new(matrix: YuvMatrix, range: Range) -> Self {
        let (kr, kb) = match matrix {
            YuvMatrix::Bt601 => (0.299, 0.114),
            YuvMatrix::Bt709 => (0.2126, 0.0722),
        };
        let (luma, chroma, black) = match range {
            Range::Full => (1.0, 1.0, 0),
            Range::Limited => (255.0 / 219.0, 255.0 / 224.0, 16),
        };
        let kg = 1.0 - kr - kb;
        let fixed = |x: f64| (x * 65536.0 + 0.5) as i32;
        Self {
            luma: fixed(luma),
            black,
            rv: fixed(chroma * 2.0 * (1.0 - kr)),
            gu: fixed(chroma * 2.0 * (1.0 - kb) * kb / kg),
            gv: fixed(chroma * 2.0 * (1.0 - kr) * kr / kg),
            bu: fixed(chroma * 2.0 * (1.0 - kb)),
        }
    }

    /// What luma adds to R, G and B, in 1/65536 codes above [`LOWEST`], and a half to round with.
    #[inline(always)]
    pub(super) fn luma(&self, y: u8) -> i32 {
        (i32::from(y) - self.black) * self.luma + 32768 - LOWEST * 65536
    }

    /// What chroma adds to each of R, G and B, in 1/65536 codes.
    #[inline(always)]
    pub(super) fn tint(&self, u: u8, v: u8) -> [i32; 3] {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        [self.rv * v, -self.gu * u - self.gv * v, self.bu * u]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Converter {
        fn steps(&self, y: u8, u: u8, v: u8) -> [i32; 3] {
            self.tint(u, v).map(|tint| step(self.luma(y), tint))
        }

        fn rgb(&self, y: u8, u: u8, v: u8) -> [u8; 3] {
            self.steps(y, u, v).map(|step| (step + LOWEST).clamp(0, 255) as u8)
        }
    }

    /// Steps are sums of a term of luma and one or two of chroma: the extremes are at extremes.
    #[test]
    fn steps_stay_within_their_bounds() {
        for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
            for range in [Range::Full, Range::Limited] {
                let converter = Converter::new(matrix, range);
                for i in 0..8_u8 {
                    let [y, u, v] = [1, 2, 4].map(|bit| if i & bit == 0 { 0 } else { 255 });
                    for step in converter.steps(y, u, v) {
                        assert!((0..STEPS as i32).contains(&step), "{matrix:?} {range:?} {step}");
                    }
                }
            }
        }
    }

    /// The luma equation forwards, in f64: an independent way to the same colours.
    fn yuv(rgb: [u8; 3], matrix: YuvMatrix, range: Range) -> [u8; 3] {
        let (kr, kb) = if matrix == YuvMatrix::Bt601 { (0.299, 0.114) } else { (0.2126, 0.0722) };
        let [r, g, b] = rgb.map(|c| f64::from(c) / 255.0);
        let y = kr * r + (1.0 - kr - kb) * g + kb * b;
        let (u, v) = ((b - y) / (2.0 * (1.0 - kb)), (r - y) / (2.0 * (1.0 - kr)));
        let (scale, black, chroma) =
            if range == Range::Full { (255.0, 0.0, 255.0) } else { (219.0, 16.0, 224.0) };
        [y * scale + black, u * chroma + 128.0, v * chroma + 128.0].map(|c| (c + 0.5).clamp(0.0, 255.0) as u8)
    }

    #[test]
    fn known_colours() {
        // BT.601 limited: the colour bars of the standard; BT.709 limited: likewise.
        let video = Converter::new(YuvMatrix::Bt601, Range::Limited);
        assert_eq!(video.rgb(16, 128, 128), [0, 0, 0]);
        assert_eq!(video.rgb(235, 128, 128), [255, 255, 255]);
        let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(&x, y)| x.abs_diff(y) <= 2);
        assert!(near(video.rgb(81, 90, 240), [255, 0, 0]));
        assert!(near(video.rgb(145, 54, 34), [0, 255, 0]));
        assert!(near(video.rgb(41, 240, 110), [0, 0, 255]));
        let hd = Converter::new(YuvMatrix::Bt709, Range::Limited);
        assert!(near(hd.rgb(63, 102, 240), [255, 0, 0]));
        assert!(near(hd.rgb(173, 42, 26), [0, 255, 0]));
        assert!(near(hd.rgb(32, 240, 118), [0, 0, 255]));
        let jpeg = Converter::new(YuvMatrix::Bt601, Range::Full);
        assert!(near(jpeg.rgb(76, 85, 255), [255, 0, 0]));
        assert_eq!(jpeg.rgb(255, 128, 128), [255, 255, 255]);
        assert_eq!(jpeg.rgb(77, 128, 128), [77, 77, 77]);
    }

    #[test]
    fn colours_survive_the_round_trip() {
        for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
            for range in [Range::Full, Range::Limited] {
                let converter = Converter::new(matrix, range);
                for r in (0..=255).step_by(15) {
                    for g in (0..=255).step_by(15) {
                        for b in (0..=255).step_by(15) {
                            let [y, u, v] = yuv([r, g, b], matrix, range);
                            let back = converter.rgb(y, u, v);
                            let off = [r, g, b].iter().zip(back).map(|(&x, z)| x.abs_diff(z)).max();
                            assert!(off <= Some(2), "{matrix:?} {range:?} {:?} {back:?}", [r, g, b]);
                        }
                    }
                }
            }
        }
    }
}
