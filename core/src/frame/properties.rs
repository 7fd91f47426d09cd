//! Properties of the whole stage: however a picture is stored it is the same picture, and it shows what a pinhole
//! camera saw.
use super::geometry::Geometry;
use super::transfer::linear_to_srgb;
use super::*;
use crate::base::exec::Inline;
use crate::base::testing::property;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

/// The photo's three planes, and the angle over its side.
fn prepared(frame: &Frame<'_>, size: usize, fov: &FieldOfView) -> (Vec<f32>, f32) {
    let mut workspace = vec![0xA5; prepare_bytes(size)];
    let image = prepare(frame, size, fov, &Inline, &mut Arena::new(&mut workspace)).expect("a good frame");
    (image.rgb.to_vec(), image.fov_deg)
}

fn farthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

/// The farthest that two pictures are apart, in 8-bit sRGB codes.
fn codes_apart(a: &[f32], b: &[f32]) -> f32 {
    let codes = |v: &[f32]| v.iter().map(|&v| 255.0 * linear_to_srgb(v)).collect::<Vec<_>>();
    farthest(&codes(a), &codes(b))
}

/// A picture of `width` x `height` pixels, RGB.
#[derive(Clone, Debug)]
struct Picture {
    width: usize,
    height: usize,
    rgb: Vec<[u8; 3]>,
}

impl Picture {
    fn at(&self, x: usize, y: usize) -> [u8; 3] {
        self.rgb[y * self.width + x]
    }

    fn from_fn(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [u8; 3]) -> Self {
        let rgb = (0..width * height).map(|i| pixel(i % width, i / width)).collect();
        Self { width, height, rgb }
    }

    fn mirrored(&self) -> Self {
        Self::from_fn(self.width, self.height, |x, y| self.at(self.width - 1 - x, y))
    }

    /// As the sensor has it that must be turned by `rotation` to stand upright.
    fn stored(&self, rotation: Rotation) -> Self {
        let (w, h) = (self.width, self.height);
        match rotation {
            Rotation::None => self.clone(),
            Rotation::Cw90 => Self::from_fn(h, w, |x, y| self.at(w - 1 - y, x)),
            Rotation::Cw180 => Self::from_fn(w, h, |x, y| self.at(w - 1 - x, h - 1 - y)),
            Rotation::Cw270 => Self::from_fn(h, w, |x, y| self.at(y, h - 1 - x)),
        }
    }
}

/// Blocks of 2 x 2 pixels of one colour, so that chroma at half the size loses nothing.
fn blocks() -> impl Strategy<Value = Picture> {
    (1..9_usize, 1..9_usize).prop_flat_map(|(w, h)| {
        proptest::collection::vec(any::<[u8; 3]>(), w * h)
            .prop_map(move |colours| Picture::from_fn(2 * w, 2 * h, |x, y| colours[y / 2 * w + x / 2]))
    })
}

/// Rows `padding` values farther apart than they must be, junk between them; and their stride.
fn padded<T: Copy>(
    height: usize,
    row: usize,
    padding: usize,
    junk: T,
    value: impl Fn(usize, usize) -> T,
) -> (Vec<T>, usize) {
    let stride = row + padding;
    let mut out = vec![junk; stride * height - padding];
    for y in 0..height {
        for i in 0..row {
            out[y * stride + i] = value(i, y);
        }
    }
    (out, stride)
}

/// A colour's Y, U and V, unrounded (ITU-R BT.601-7, BT.709-6).
fn yuv(rgb: [u8; 3], matrix: YuvMatrix, range: Range) -> [u8; 3] {
    let (kr, kb) = match matrix {
        YuvMatrix::Bt601 => (0.299, 0.114),
        YuvMatrix::Bt709 => (0.2126, 0.0722),
    };
    let [r, g, b] = rgb.map(|v| f64::from(v) / 255.0);
    let y = kr * r + (1.0 - kr - kb) * g + kb * b;
    let (u, v) = ((b - y) / (2.0 - 2.0 * kb), (r - y) / (2.0 - 2.0 * kr));
    let [y, u, v] = match range {
        Range::Full => [255.0 * y, 128.0 + 255.0 * u, 128.0 + 255.0 * v],
        Range::Limited => [16.0 + 219.0 * y, 128.0 + 224.0 * u, 128.0 + 224.0 * v],
    };
    [y, u, v].map(|v| v.round().clamp(0.0, 255.0) as u8)
}

/// The EXIF orientations as the frame stage has them: turn clockwise by this, and the picture is upright, or upright in
/// a mirror.
const ORIENTATIONS: [(u8, Rotation, bool); 8] = [
    (1, Rotation::None, false),
    (2, Rotation::None, true),
    (3, Rotation::Cw180, false),
    (4, Rotation::Cw180, true),
    (5, Rotation::Cw90, true),
    (6, Rotation::Cw90, false),
    (7, Rotation::Cw270, true),
    (8, Rotation::Cw270, false),
];

#[test]
fn a_picture_is_the_same_in_every_orientation_format_stride_and_range() {
    let inputs = (blocks(), 1..20_usize, 0..9_usize, any::<u8>(), 30.0..100.0_f32);
    property(40, inputs, |(picture, size, padding, junk, degrees)| {
        let fov = FieldOfView::shorter_side(degrees);
        for (orientation, rotation, mirror) in ORIENTATIONS {
            let upright = if mirror { picture.mirrored() } else { picture.clone() };
            let flat: Vec<u8> = upright.rgb.concat();
            let frame = Frame::rgb8(&flat, upright.width, upright.height, 3 * upright.width).expect("frame");
            let (wanted, angle) = prepared(&frame, size, &fov);
            let stored = upright.stored(rotation);
            let (w, h) = (stored.width, stored.height);
            let got = |frame: Frame<'_>| {
                let (rgb, fov_deg) = prepared(&frame.rotated(rotation), size, &fov);
                assert_eq!(fov_deg, angle);
                rgb
            };
            let packed = |order: &[usize]| {
                let step = order.len();
                padded(h, step * w, padding, junk, |i, y| {
                    stored.at(i / step, y).get(order[i % step]).copied().unwrap_or(junk)
                })
            };

            let (data, stride) = packed(&[0, 1, 2]);
            let rgb8 = got(Frame::rgb8(&data, w, h, stride).expect("frame"));
            prop_assert!(farthest(&rgb8, &wanted) < 2e-6, "orientation {}", orientation);
            let (data, stride) = packed(&[0, 1, 2, 3]);
            prop_assert_eq!(&got(Frame::rgba8(&data, w, h, stride).expect("frame")), &rgb8);
            let (data, stride) = packed(&[2, 1, 0, 3]);
            prop_assert_eq!(&got(Frame::bgra8(&data, w, h, stride).expect("frame")), &rgb8);
            let wide = |i: usize, y: usize| u16::from(stored.at(i / 3, y)[i % 3]) * 257;
            let (data, stride) = padded(h, 3 * w, padding, 0xFFFF, wide);
            let rgb16 = got(Frame::rgb16(&data, w, h, stride).expect("frame"));
            prop_assert!(farthest(&rgb16, &wanted) < 4e-6, "16 bits, orientation {}", orientation);
            let float = |i: usize, y: usize| f32::from(stored.at(i / 3, y)[i % 3]) / 255.0;
            let (data, stride) = padded(h, 3 * w, padding, f32::NAN, float);
            let frame = Frame::rgb_f32(&data, w, h, stride).expect("frame").encoded(Encoding::Srgb);
            prop_assert!(farthest(&got(frame), &wanted) < 4e-6, "float, orientation {}", orientation);

            for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
                for range in [Range::Full, Range::Limited] {
                    let code = |x: usize, y: usize, c: usize| yuv(stored.at(x, y), matrix, range)[c];
                    let colour = |frame: Frame<'_>| got(frame.yuv_colour(matrix, range));
                    let (luma, row) = padded(h, w, padding, junk, |x, y| code(x, y, 0));
                    let pairs = |first: usize| {
                        padded(h / 2, w, padding, junk, move |i, y| {
                            code(i / 2 * 2, 2 * y, if i % 2 == 0 { first } else { 3 - first })
                        })
                    };
                    let (uv, chroma) = pairs(1);
                    let nv12 = colour(Frame::nv12(&luma, row, &uv, chroma, w, h).expect("frame"));
                    // Rounded to 8 bits twice: half a code of chroma, 2.1 times as much of blue, and limited codes are
                    // 1.16 times as coarse.
                    let apart = codes_apart(&nv12, &wanted);
                    prop_assert!(apart < 3.0, "{:?} {:?}: {} codes", matrix, range, apart);
                    let (vu, chroma) = pairs(2);
                    let nv21 = colour(Frame::nv21(&luma, row, &vu, chroma, w, h).expect("frame"));
                    prop_assert_eq!(&nv21, &nv12);
                    // Three planes: chroma pixels 1 to 3 bytes apart, luma's 1 or 2.
                    let (far, near) = (1 + padding % 3, 1 + padding % 2);
                    let spread = |c: usize| {
                        padded(h / 2, far * (w / 2 - 1) + 1, padding, junk, move |i, y| {
                            if i % far == 0 { code(i / far * 2, 2 * y, c) } else { junk }
                        })
                    };
                    let (luma, row) = padded(h, near * (w - 1) + 1, padding, junk, |i, y| {
                        if i % near == 0 { code(i / near, y, 0) } else { junk }
                    });
                    let ((u, chroma), (v, _)) = (spread(1), spread(2));
                    let planes = YuvPlanes {
                        y: &luma,
                        y_row_stride: row,
                        y_pixel_stride: near,
                        u: &u,
                        v: &v,
                        uv_row_stride: chroma,
                        uv_pixel_stride: far,
                    };
                    prop_assert_eq!(&colour(Frame::yuv420(planes, w, h).expect("frame")), &nv12);
                }
            }
        }
        Ok(())
    });
}

/// A pinhole camera above the plane: each pixel's ray meets it at a point, and the pixel's colour says which. What comes
/// out must say at each pixel the point that [`Geometry`] has for it: crop, angle and turn agree, or it does not.
#[test]
fn the_square_shows_what_a_pinhole_camera_saw() {
    let known = prop_oneof![
        (3.0..140.0_f32).prop_map(PhotoFov::ShorterSide),
        (9.0..300.0_f32).prop_map(PhotoFov::Focal35mm)
    ];
    let rotation =
        prop_oneof![Just(Rotation::None), Just(Rotation::Cw90), Just(Rotation::Cw180), Just(Rotation::Cw270)];
    let inputs = ((8..70_usize, 8..70_usize), known, 5.0..120.0_f32, rotation, 1..16_usize);
    property(300, inputs, |((width, height), photo, target_deg, rotation, size)| {
        let (w, h) = (width as f64, height as f64);
        // Focal length in pixels.
        let focal = match photo {
            PhotoFov::ShorterSide(degrees) => w.min(h) / 2.0 / (f64::from(degrees).to_radians() / 2.0).tan(),
            PhotoFov::Focal35mm(mm) => f64::from(mm) * w.hypot(h) / 36.0_f64.hypot(24.0),
            PhotoFov::Unknown => unreachable!(),
        };
        let reach = w.max(h) / 2.0 / focal;
        // Upright x to the right and y up of the point at the stored pixel's centre, as shares of the reach.
        let point = |i: usize| {
            let (x, y) = ((i % width) as f64 + 0.5 - w / 2.0, h / 2.0 - (i / width) as f64 - 0.5);
            let (x, y) = match rotation {
                Rotation::None => (x, y),
                Rotation::Cw90 => (y, -x),
                Rotation::Cw180 => (-x, -y),
                Rotation::Cw270 => (-y, x),
            };
            [x / focal / reach, y / focal / reach].map(|v| (0.5 + 0.5 * v) as f32)
        };
        let data: Vec<f32> = (0..width * height).flat_map(|i| [point(i)[0], point(i)[1], 0.5]).collect();
        let frame = Frame::rgb_f32(&data, width, height, 3 * width).expect("frame").rotated(rotation);
        let fov = FieldOfView { photo, target_deg };
        let crop = frame.crop(&fov).expect("angles");
        // As wide as wanted, or as wide as the photo is.
        let whole = 2.0 * (w.min(h) / 2.0 / focal).atan().to_degrees();
        let wanted = whole.min(f64::from(target_deg));
        prop_assert!(
            (f64::from(crop.fov_deg) - wanted).abs() < 1e-3,
            "{} instead of {}",
            crop.fov_deg,
            wanted
        );
        let side = 2.0 * focal * (wanted.to_radians() / 2.0).tan();
        prop_assert!((crop.side - side).abs() < 1e-4 * side, "{} instead of {}", crop.side, side);
        // Smaller crops are interpolated, and what lies beyond the outermost pixels' centres is not known.
        prop_assume!(crop.side >= size as f64);
        let (rgb, fov_deg) = prepared(&frame, size, &fov);
        let geometry = Geometry::new(size, fov_deg);
        for i in 0..size * size {
            let at = geometry.point(i / size, i % size);
            let seen = [rgb[i], rgb[size * size + i]].map(|v| (2.0 * v - 1.0) * reach as f32);
            // The mean over a box of what grows evenly is its centre's, but for the source pixels that its two ends cut:
            // each counts as if it lay inside, at most an eighth of a source pixel off for a box of one.
            let cut = 0.126 / (crop.side / size as f64) / focal;
            let tolerance = (2e-5 * reach.max(0.05) + cut) as f32;
            prop_assert!(
                (seen[0] - at.x).abs() < tolerance && (seen[1] - at.y).abs() < tolerance,
                "pixel {} shows {:?}, not {:?}",
                i,
                seen,
                at
            );
        }
        Ok(())
    });
}
