//! The frame stage against an oracle in f64 that knows nothing of rows, and against itself in another layout.
use super::transfer::srgb_to_linear;
use super::*;
use crate::base::exec::{At, Inline};
use crate::base::simd::{Level, Simd};
use crate::base::testing::property;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

struct Prepared {
    rgb: Vec<f32>,
    clipped: Vec<u8>,
    exposure: Exposure,
    fov_deg: f32,
}

fn prepared_by(exec: &dyn Executor, frame: &Frame<'_>, size: usize, fov: &FieldOfView) -> Prepared {
    let mut workspace = vec![0xA5; prepare_bytes(size)];
    let image = prepare(frame, size, fov, exec, &mut Arena::new(&mut workspace)).expect("a good frame");
    image.check().expect("lengths");
    let (rgb, clipped) = (image.rgb.to_vec(), image.clipped.to_vec());
    Prepared { rgb, clipped, exposure: image.exposure, fov_deg: image.fov_deg }
}

fn prepared(frame: &Frame<'_>, size: usize, fov: &FieldOfView) -> Prepared {
    prepared_by(&Inline, frame, size, fov)
}

fn whole(frame: &Frame<'_>, size: usize) -> Prepared {
    prepared(frame, size, &FieldOfView::default())
}

fn farthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

/// Width, height and RGB bytes of a random image.
fn image(sides: core::ops::Range<usize>) -> impl Strategy<Value = (usize, usize, Vec<u8>)> {
    (sides.clone(), sides)
        .prop_flat_map(|(w, h)| (Just(w), Just(h), proptest::collection::vec(any::<u8>(), 3 * w * h)))
}

/// Mean over boxes in f64: every source pixel's overlap with every output pixel; and the clipped ones', channels apart.
fn oracle(data: &[u8], width: usize, height: usize, crop: &Crop, size: usize) -> (Vec<f32>, Vec<f64>) {
    let step = crop.side / size as f64;
    let overlap = |from: f64, pixel: usize| {
        ((from + step).min(pixel as f64 + 1.0) - from.max(pixel as f64)).max(0.0) / step
    };
    let (mut out, mut areas) = (vec![0.0_f64; 3 * size * size], vec![0.0_f64; 3 * size * size]);
    for i in 0..size {
        for j in 0..size {
            for y in 0..height {
                let down = overlap(crop.y + step * i as f64, y);
                for x in 0..if down > 0.0 { width } else { 0 } {
                    let across = overlap(crop.x + step * j as f64, x);
                    for c in 0..3 {
                        let code = data[3 * (y * width + x) + c];
                        let linear = f64::from(srgb_to_linear(f32::from(code) / 255.0));
                        let at = (c * size + i) * size + j;
                        out[at] += down * across * linear;
                        areas[at] += if code >= 254 { down * across } else { 0.0 };
                    }
                }
            }
        }
    }
    (out.iter().map(|&v| v as f32).collect(), areas)
}

/// Whether marks and shares are those of these areas; a box of which half is clipped but for rounding may have either mark.
fn same_clipping(got: &Prepared, areas: &[f64]) -> bool {
    let plane = got.clipped.len();
    let marked = |i: usize| got.clipped[i % plane] >> (i / plane) & 1 == 1;
    let all = areas.iter().all(|&area| area > 0.5 - 1e-5);
    let marks = areas.iter().enumerate().all(|(i, &area)| {
        let limit = if all { 1.0 - 1e-5 } else { 0.5 };
        (area - limit).abs() < 1e-5 || marked(i) == (area >= limit)
    });
    let shares = areas.chunks(plane).map(|areas| areas.iter().sum::<f64>() / plane as f64);
    marks && shares.zip(got.exposure.clipped).all(|(share, got)| (share - f64::from(got)).abs() < 1e-5)
}

#[test]
fn area_resampling_is_the_mean_over_boxes() {
    property(200, (image(1..24), 1..24_usize, 20.0..80.0_f32), |((w, h, data), size, degrees)| {
        let frame = Frame::rgb8(&data, w, h, 3 * w).expect("frame");
        let fov = FieldOfView::shorter_side(degrees);
        let crop = frame.crop(&fov).expect("angle");
        prop_assume!(crop.side >= size as f64);
        let (got, (rgb, areas)) = (prepared(&frame, size, &fov), oracle(&data, w, h, &crop, size));
        prop_assert!(farthest(&got.rgb, &rgb) < 2e-6);
        prop_assert!(same_clipping(&got, &areas));
        prop_assert_eq!(got.fov_deg, crop.fov_deg);
        Ok(())
    });
}

/// Boxes longer than what is added up at once, and more boxes in a row than are worked on at once.
#[test]
fn boxes_and_rows_of_any_length() {
    let at = |i: usize| (i as u32).wrapping_mul(2_654_435_761).to_be_bytes()[0];
    for (w, h) in [(143, 131), (131, 200), (97, 97)] {
        let noise: Vec<u8> = (0..3 * w * h).map(at).collect();
        let mut dot = vec![90; 3 * w * h];
        dot[40_000 % (3 * w * h)] = 255;
        let white = vec![255; 3 * w * h];
        for (data, size) in
            [(&dot, 1), (&white, 1), (&noise, 2), (&noise, 33), (&dot, 65), (&noise, 96), (&white, 97)]
        {
            let frame = Frame::rgb8(data, w, h, 3 * w).expect("frame");
            let crop = frame.crop(&FieldOfView::default()).expect("angle");
            let (got, (rgb, areas)) = (whole(&frame, size), oracle(data, w, h, &crop, size));
            assert!(farthest(&got.rgb, &rgb) < 2e-6, "{w} {h} {size}");
            assert!(same_clipping(&got, &areas), "{w} {h} {size}");
        }
    }
    // Boxes of 5000 pixels a row, more than are added up at once.
    let long: Vec<u8> = (0..3 * 5000 * 3).map(at).collect();
    let row = |y: usize| &long[3 * 5000 * y..3 * 5000 * (y + 1)];
    let square = [0, 1, 2].map(row).concat().repeat(5000 / 3 + 1);
    let frame = Frame::rgb8(&square, 5000, 5000, 3 * 5000).expect("frame");
    let got = whole(&frame, 1);
    let mean = |c: usize| {
        let codes = square.iter().take(3 * 5000 * 5000).skip(c).step_by(3);
        let sum: f64 = codes.map(|&code| f64::from(srgb_to_linear(f32::from(code) / 255.0))).sum();
        (sum / 25e6) as f32
    };
    assert!(farthest(&got.rgb, &[0, 1, 2].map(mean)) < 1e-6 && got.clipped == [0]);
    // Two codes of 256 are clipped.
    assert!(
        got.exposure.clipped.iter().all(|share| (share - 2.0 / 256.0).abs() < 4e-3),
        "{:?}",
        got.exposure
    );
    // A million pixels and more in one box: their sum does not overflow.
    let side = 1100;
    let data: Vec<u8> = (0..3 * side * side).map(|i| 235 + i as u8 % 19).collect();
    let mean = |c: usize| {
        let codes =
            data.iter().skip(c).step_by(3).map(|&code| f64::from(srgb_to_linear(f32::from(code) / 255.0)));
        (codes.sum::<f64>() / (side * side) as f64) as f32
    };
    let got = whole(&Frame::rgb8(&data, side, side, 3 * side).expect("frame"), 1);
    assert!(farthest(&got.rgb, &[0, 1, 2].map(mean)) < 1e-6 && got.clipped == [0]);
}

#[test]
fn the_mean_of_a_square_is_kept() {
    property(100, (1..40_usize, 1..40_usize, any::<u64>()), |(side, size, seed)| {
        prop_assume!(size <= side);
        let data: Vec<f32> = (0..3 * side * side)
            .map(|i| (seed.wrapping_mul(2 * i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f32)
            .map(|v| v / 16_777_216.0)
            .collect();
        let frame = Frame::rgb_f32(&data, side, side, 3 * side).expect("frame");
        let got = whole(&frame, size);
        for (c, plane) in got.rgb.chunks(size * size).enumerate() {
            let before =
                data.iter().skip(c).step_by(3).map(|&v| f64::from(v)).sum::<f64>() / (side * side) as f64;
            let after = plane.iter().map(|&v| f64::from(v)).sum::<f64>() / (size * size) as f64;
            prop_assert!((before - after).abs() < 1e-6, "{} {}", before, after);
        }
        Ok(())
    });
}

#[test]
fn equal_size_copies_exactly() {
    property(50, (1..20_usize, any::<u64>()), |(side, seed)| {
        let data: Vec<u8> =
            (0..3 * side * side).map(|i| (seed.rotate_left(i as u32 % 64) >> 7) as u8).collect();
        let frame = Frame::rgb8(&data, side, side, 3 * side).expect("frame");
        let got = whole(&frame, side);
        for (i, &code) in data.iter().enumerate() {
            let at = i % 3 * side * side + i / 3;
            prop_assert_eq!(got.rgb[at], srgb_to_linear(f32::from(code) / 255.0));
        }
        for (pixel, &clipped) in data.chunks(3).zip(&got.clipped) {
            let mark = |c: usize| u8::from(pixel[c] >= 254) << c;
            prop_assert_eq!(clipped, mark(0) | mark(1) | mark(2));
        }
        Ok(())
    });
}

/// The stored image that a turn by `rotation` makes upright.
fn stored(upright: &[u8], w: usize, h: usize, rotation: Rotation) -> (Vec<u8>, usize, usize) {
    let (sw, sh) = if matches!(rotation, Rotation::Cw90 | Rotation::Cw270) { (h, w) } else { (w, h) };
    let mut out = vec![0; 3 * w * h];
    for y in 0..h {
        for x in 0..w {
            let (sx, sy) = match rotation {
                Rotation::None => (x, y),
                // Clockwise: the stored left column becomes the top row, read from the bottom.
                Rotation::Cw90 => (y, w - 1 - x),
                Rotation::Cw180 => (w - 1 - x, h - 1 - y),
                Rotation::Cw270 => (h - 1 - y, x),
            };
            let (to, from) = (3 * (sy * sw + sx), 3 * (y * w + x));
            out[to..to + 3].copy_from_slice(&upright[from..from + 3]);
        }
    }
    (out, sw, sh)
}

#[test]
fn a_turned_photo_gives_the_upright_image() {
    property(100, (image(1..20), 1..24_usize, 30.0..80.0_f32), |((w, h, data), size, degrees)| {
        let fov = FieldOfView::shorter_side(degrees);
        let upright = prepared(&Frame::rgb8(&data, w, h, 3 * w).expect("frame"), size, &fov);
        for rotation in [Rotation::Cw90, Rotation::Cw180, Rotation::Cw270] {
            let (turned, tw, th) = stored(&data, w, h, rotation);
            let frame = Frame::rgb8(&turned, tw, th, 3 * tw).expect("frame").rotated(rotation);
            let got = prepared(&frame, size, &fov);
            prop_assert!(farthest(&got.rgb, &upright.rgb) < 2e-6, "{:?}", rotation);
            prop_assert_eq!(&got.clipped, &upright.clipped);
        }
        Ok(())
    });
}

#[test]
fn layouts_and_strides_do_not_matter() {
    property(60, (image(1..14), 1..14_usize, 0..9_usize, any::<u8>()), |((w, h, data), size, pad, junk)| {
        let plain = whole(&Frame::rgb8(&data, w, h, 3 * w).expect("frame"), size);
        // Rows of `step` values to the pixel, each row with `pad` values of junk after it but the last.
        let padded = |step: usize, order: [usize; 3]| {
            let stride = step * w + pad;
            let mut out = vec![junk; stride * h - pad];
            for (i, pixel) in data.chunks(3).enumerate() {
                for (c, &code) in pixel.iter().enumerate() {
                    out[i / w * stride + i % w * step + order[c]] = code;
                }
            }
            (out, stride)
        };
        let (rgb, stride) = padded(3, [0, 1, 2]);
        let same = |frame: Frame<'_>| {
            let got = whole(&frame, size);
            (farthest(&got.rgb, &plain.rgb), got.clipped == plain.clipped)
        };
        prop_assert_eq!(same(Frame::rgb8(&rgb, w, h, stride).expect("frame")), (0.0, true));
        let wide: Vec<u16> = rgb.iter().map(|&c| u16::from(c) * 257).collect();
        let (far, clipped) = same(Frame::rgb16(&wide, w, h, stride).expect("frame"));
        prop_assert!(far < 1e-6 && clipped);
        let float: Vec<f32> = rgb.iter().map(|&c| f32::from(c) / 255.0).collect();
        let encoded = Frame::rgb_f32(&float, w, h, stride).expect("frame").encoded(Encoding::Srgb);
        prop_assert!(same(encoded).0 < 1e-6);
        let (rgba, stride) = padded(4, [0, 1, 2]);
        prop_assert_eq!(same(Frame::rgba8(&rgba, w, h, stride).expect("frame")), (0.0, true));
        let (bgra, stride) = padded(4, [2, 1, 0]);
        prop_assert_eq!(same(Frame::bgra8(&bgra, w, h, stride).expect("frame")), (0.0, true));
        Ok(())
    });
}

#[test]
fn yuv_layouts_agree() {
    property(60, (image(1..14), 1..14_usize, 0..5_usize, 0..5_usize), |((w, h, noise), size, py, pc)| {
        let (cw, ch) = (w.div_ceil(2), h.div_ceil(2));
        let at = |i: usize| noise[i % noise.len()];
        let luma: Vec<u8> = (0..(w + py) * h).map(at).collect();
        let u: Vec<u8> = (0..cw * ch).map(|i| at(7 * i + 1)).collect();
        let v: Vec<u8> = (0..cw * ch).map(|i| at(5 * i + 2)).collect();
        let stride = 2 * cw + pc;
        let (mut uv, mut vu) = (vec![9; stride * ch], vec![9; stride * ch]);
        for i in 0..cw * ch {
            let to = i / cw * stride + i % cw * 2;
            (uv[to], uv[to + 1], vu[to], vu[to + 1]) = (u[i], v[i], v[i], u[i]);
        }
        let planar = YuvPlanes {
            y: &luma,
            y_row_stride: w + py,
            y_pixel_stride: 1,
            u: &u,
            v: &v,
            uv_row_stride: cw,
            uv_pixel_stride: 1,
        };
        for (matrix, range) in [(YuvMatrix::Bt601, Range::Full), (YuvMatrix::Bt709, Range::Limited)] {
            let bits = |frame: Frame<'_>| whole(&frame.yuv_colour(matrix, range), size).rgb;
            let expected = bits(Frame::yuv420(planar, w, h).expect("frame"));
            prop_assert_eq!(&bits(Frame::nv12(&luma, w + py, &uv, stride, w, h).expect("frame")), &expected);
            prop_assert_eq!(&bits(Frame::nv21(&luma, w + py, &vu, stride, w, h).expect("frame")), &expected);
        }
        Ok(())
    });
}

#[test]
fn known_yuv_colours_become_linear_light() {
    // BT.601 limited, 2x2 each: red (81, 90, 240), mid grey (126, 128, 128) = code 128.
    let (y, uv) = ([81, 81, 126, 126, 81, 81, 126, 126], [90, 240, 128, 128]);
    let frame = Frame::nv12(&y, 4, &uv, 4, 4, 2).expect("frame");
    let frame = frame.yuv_colour(YuvMatrix::Bt601, Range::Limited);
    let got = whole(&frame, 2);
    // The central square is columns 1 and 2: one red, one grey.
    assert!((got.rgb[0] - 1.0).abs() < 0.02 && got.rgb[4] < 0.001 && got.rgb[8] < 0.001, "{:?}", got.rgb);
    for c in 0..3 {
        assert!((got.rgb[4 * c + 1] - srgb_to_linear(128.0 / 255.0)).abs() < 1e-6, "{:?}", got.rgb);
    }
    assert_eq!(got.clipped, [1, 0, 1, 0]);
    assert_eq!(got.exposure.clipped, [0.5, 0.0, 0.0]);
}

#[test]
fn p3_colours_are_taken_to_srgb_and_clamped() {
    let linear = |rgb: [f32; 3], encoding| {
        let frame = Frame::rgb_f32(&rgb, 1, 1, 3).expect("frame").encoded(encoding);
        whole(&frame, 1).rgb
    };
    assert_eq!(linear([1.0, 0.0, 0.0], Encoding::DisplayP3), [1.0, 0.0, 0.0]);
    let grey = linear([0.5; 3], Encoding::DisplayP3);
    assert!(farthest(&grey, &[srgb_to_linear(0.5); 3]) < 1e-6);
    // Within sRGB: 0.5, 0.4, 0.3 encoded = 0.214041, 0.132868, 0.073239 linear, times the matrix's rows.
    let colour = linear([0.5, 0.4, 0.3], Encoding::DisplayP3);
    assert!(farthest(&colour, &[0.232_300, 0.129_454, 0.065_785]) < 2e-6, "{colour:?}");
    assert_eq!(linear([0.25, 7.0, 0.5], Encoding::Linear), [0.25, 1.0, 0.5]);
}

#[test]
fn small_photos_are_interpolated() {
    let one = whole(&Frame::rgb8(&[255, 0, 128], 1, 1, 3).expect("frame"), 8);
    assert!(one.rgb[..64].iter().all(|&v| v == 1.0) && one.rgb[64..128].iter().all(|&v| v == 0.0));
    assert!(one.clipped.iter().all(|&c| c == 0b001));
    let line = vec![77; 150_000];
    for (w, h) in [(50_000, 1), (1, 50_000)] {
        let got = whole(&Frame::rgb8(&line, w, h, 3 * w).expect("frame"), 4);
        assert!(got.rgb.iter().all(|&v| (v - srgb_to_linear(77.0 / 255.0)).abs() < 1e-7));
    }
    // A ramp stays a ramp between the outermost pixel centres.
    let ramp: Vec<f32> = (0..16).flat_map(|i| [(i % 4) as f32 / 4.0; 3]).collect();
    let got = whole(&Frame::rgb_f32(&ramp, 4, 4, 12).expect("frame"), 8);
    let expected = [0.0, 0.0625, 0.1875, 0.3125, 0.4375, 0.5625, 0.6875, 0.75];
    for row in got.rgb.chunks(8) {
        assert!(farthest(row, &expected) < 1e-6, "{row:?}");
    }
}

#[test]
fn a_pixel_is_clipped_in_the_channels_in_which_half_of_it_is() {
    let mut data = vec![100_u8; 3 * 10 * 10];
    let mut clip = |x: usize, y: usize, c: usize| data[3 * (10 * y + x) + c] = 254;
    // Boxes of 2.5. Green: one pixel that lies in two boxes, 0.5 and 0.5 of their 6.25.
    clip(7, 3, 1);
    // Blue: columns 0 and 1 of box (0, 0), 5 of its 6.25. Red: half a column less, 2.5.
    (0..3).for_each(|y| (0..2).for_each(|x| clip(x, y, 2)));
    (0..3).for_each(|y| clip(9, y, 0));
    let got = whole(&Frame::rgb8(&data, 10, 10, 30).expect("frame"), 4);
    let marked: Vec<(usize, u8)> =
        got.clipped.iter().copied().enumerate().filter(|(_, mark)| *mark != 0).collect();
    assert_eq!(marked, [(0, 0b100)]);
    let shares = [0.03, 0.01, 0.06];
    assert!(farthest(&got.exposure.clipped, &shares) < 1e-6, "{:?}", got.exposure);
    let bgra: Vec<u8> = data.as_chunks::<3>().0.iter().flat_map(|[r, g, b]| [*b, *g, *r, 0]).collect();
    let swapped = whole(&Frame::bgra8(&bgra, 10, 10, 40).expect("frame"), 4);
    assert_eq!((swapped.clipped, swapped.exposure), (got.clipped, got.exposure));
}

/// Glitter: white dots everywhere, at any density, in any format, leave a photo that can be used.
#[test]
fn glitter_leaves_what_is_between() {
    for (dense, left) in [(2, true), (11, true), (16, false)] {
        let code = |i: usize| if (i / 3 * 7 + i / 192 * 3) % 16 < dense { 255 } else { 90 };
        let data: Vec<u8> = (0..3 * 64 * 64).map(code).collect();
        let share = data.iter().filter(|code| **code >= 254).count() as f32 / data.len() as f32;
        let wide: Vec<u16> = data.iter().map(|&c| u16::from(c) * 257).collect();
        let float: Vec<f32> = data.iter().map(|&c| f32::from(c) / 255.0).collect();
        for frame in [
            Frame::rgb8(&data, 64, 64, 192),
            Frame::rgb16(&wide, 64, 64, 192),
            Frame::rgb_f32(&float, 64, 64, 192),
        ] {
            let got = whole(&frame.expect("frame"), 8);
            assert_eq!(got.clipped.iter().any(|mark| *mark != ALL_CLIPPED), left, "{dense}");
            assert!((got.exposure.clipped_share() - share).abs() < 1e-6, "{share} {:?}", got.exposure);
        }
    }
}

#[test]
fn the_crop_follows_from_the_field_of_view() {
    let data = vec![0; 3 * 400 * 300];
    let frame = Frame::rgb8(&data, 400, 300, 1200).expect("frame");
    let crop = |fov| frame.crop(&fov);
    // tan(21.675 deg) / tan(30 deg) = 0.397443 / 0.577350 = 0.688391.
    let wide = crop(FieldOfView::shorter_side(60.0)).expect("angle");
    assert!((wide.side - 206.517).abs() < 0.01 && wide.fov_deg == 43.35, "{wide:?}");
    assert!(
        (wide.x - (400.0 - wide.side) / 2.0).abs() < 1e-9
            && (wide.y - (300.0 - wide.side) / 2.0).abs() < 1e-9
    );
    let narrow = crop(FieldOfView::shorter_side(30.0)).expect("angle");
    assert!(narrow.side == 300.0 && (narrow.fov_deg - 30.0).abs() < 1e-4, "{narrow:?}");
    // 26 mm: half the short side of a 4:3 sensor with a 43.27 mm diagonal is 12.98 mm: 12.98/26 = 0.499230.
    let phone = crop(FieldOfView::focal_35mm(26.0)).expect("length");
    assert!((phone.side - 300.0 * 0.397_443 / 0.499_230).abs() < 0.02, "{phone:?}");
    let unknown = crop(FieldOfView::default()).expect("nothing known");
    assert_eq!((unknown.side, unknown.fov_deg), (300.0, 43.35));
    for bad in [0.0, -5.0, 180.0, f32::NAN, f32::INFINITY] {
        assert_eq!(crop(FieldOfView::shorter_side(bad)), Err(Error::FieldOfView));
        assert_eq!(crop(FieldOfView { target_deg: bad, ..FieldOfView::default() }), Err(Error::FieldOfView));
    }
    // Real focal lengths of phones are none of a 35 mm equivalent.
    for bad in [0.0, -26.0, 4.2, 7.9, 5001.0, f32::NAN, f32::INFINITY] {
        assert_eq!(crop(FieldOfView::focal_35mm(bad)), Err(Error::FocalLength), "{bad}");
    }
    assert!(std::format!("{}", Error::FocalLength).contains("did you pass FocalLength instead of"));
    assert!(crop(FieldOfView::focal_35mm(8.0)).is_ok());
}

#[test]
fn every_misuse_has_its_error() {
    let data = [0_u8; 64];
    let error = |r: Result<Frame<'_>, Error>| r.err();
    assert_eq!(error(Frame::rgb8(&data, 0, 4, 12)), Some(Error::FrameEmpty));
    assert_eq!(error(Frame::rgb8(&data, 4, 0, 12)), Some(Error::FrameEmpty));
    assert_eq!(error(Frame::rgb8(&data, 4, 4, 11)), Some(Error::FrameStride { needed: 12, given: 11 }));
    assert_eq!(error(Frame::rgb8(&data, 4, 6, 12)), Some(Error::FrameBuffer { needed: 72, given: 64 }));
    assert_eq!(error(Frame::rgba8(&data, 4, 2, usize::MAX)), Some(Error::FrameTooLarge));
    assert_eq!(error(Frame::rgba8(&data, usize::MAX, 2, usize::MAX)), Some(Error::FrameTooLarge));
    assert_eq!(
        error(Frame::nv12(&data, 4, &data[..7], 4, 4, 4)),
        Some(Error::FrameBuffer { needed: 7, given: 6 })
    );
    assert_eq!(
        error(Frame::nv21(&data, 3, &data, 4, 4, 4)),
        Some(Error::FrameStride { needed: 4, given: 3 })
    );
    for (bad, at) in [(f32::NAN, 4), (f32::INFINITY, 0), (-1e-9, 11)] {
        let mut pixels = [0.5; 14];
        pixels[at] = bad;
        let (x, y) = if at < 7 { (at / 3, 0) } else { ((at - 7) / 3, 1) };
        assert_eq!(error(Frame::rgb_f32(&pixels, 2, 2, 7)), Some(Error::FramePixel { x, y }));
    }
    // What lies between the rows is not a pixel.
    let mut pixels = [0.5; 14];
    pixels[6] = f32::NAN;
    assert_eq!(error(Frame::rgb_f32(&pixels, 2, 2, 7)), None);
    let frame = Frame::rgb8(&data, 4, 4, 12).expect("frame");
    let run = |size: usize, bytes: usize| {
        let mut workspace = vec![0; bytes];
        let fov = FieldOfView::default();
        prepare(&frame, size, &fov, &Inline, &mut Arena::new(&mut workspace)).err()
    };
    assert_eq!(run(0, 64), Some(Error::Size { size: 0 }));
    assert_eq!(run(MAX_SIZE + 1, 64), Some(Error::Size { size: MAX_SIZE + 1 }));
    assert!(matches!(run(16, 2000), Some(Error::WorkspaceTooSmall { .. })));
}

#[test]
fn no_size_or_stride_panics() {
    let sides = prop_oneof![0..9_usize, Just(usize::MAX), Just(1 << 20), any::<usize>()];
    let strides = prop_oneof![0..40_usize, Just(usize::MAX), any::<usize>()];
    let inputs = (sides.clone(), sides, [strides.clone(), strides.clone(), strides], 0..200_usize);
    property(3000, inputs, |(w, h, [a, b, c], len)| {
        let (bytes, wide, float) = (vec![7_u8; len], vec![7_u16; len], vec![0.5_f32; len]);
        let planes = YuvPlanes {
            y: &bytes,
            y_row_stride: a,
            y_pixel_stride: b % 3,
            u: &bytes,
            v: &bytes[len / 2..],
            uv_row_stride: b,
            uv_pixel_stride: c,
        };
        let frames = [
            Frame::rgb8(&bytes, w, h, a),
            Frame::bgra8(&bytes, w, h, b),
            Frame::rgb16(&wide, w, h, a),
            Frame::rgb_f32(&float, w, h, c),
            Frame::nv12(&bytes, a, &bytes, b, w, h),
            Frame::yuv420(planes, w, h),
        ];
        for frame in frames.iter().flatten() {
            let got = whole(frame, 5);
            prop_assert!(got.rgb.iter().all(|v| (0.0..=1.0).contains(v)));
        }
        Ok(())
    });
}

#[test]
fn the_cpu_level_does_not_change_a_bit() {
    let data: Vec<u8> = (0..3 * 97 * 61).map(|i| (i * 37 % 251) as u8).collect();
    let rgb = Frame::rgb8(&data, 97, 61, 291).expect("frame");
    let yuv = Frame::nv12(&data, 97, &data[97 * 61..], 98, 97, 61).expect("frame");
    for (frame, size) in [(&rgb, 7), (&rgb, 60), (&yuv, 33), (&rgb, 129)] {
        let fov = FieldOfView::shorter_side(50.0);
        let baseline = prepared(frame, size, &fov);
        for simd in Level::ALL.into_iter().filter_map(|level| Simd::for_level(level).ok()) {
            let got = prepared_by(&At::new(&Inline, simd), frame, size, &fov);
            assert!(got.rgb == baseline.rgb && got.clipped == baseline.clipped, "{simd:?} {size}");
        }
    }
}

/// Rows added up by columns give what pixel after pixel gives: any size, crop, stride and layout, noise and extremes.
#[test]
fn registers_do_not_change_a_bit() {
    let sizes = (1..500_usize, 1..500_usize, 1..180_usize, 0..9_usize);
    let kinds = (any::<u64>(), 0..6_u8, 44.0..120.0_f32, any::<bool>());
    property(150, (sizes, kinds), |((w, h, size, pad), (seed, kind, degrees, four))| {
        let value = |i: usize| {
            let random = ((seed ^ i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u32;
            match kind {
                0 => 255,
                1 => 0,
                2 => 253 + random.is_multiple_of(300) as u8,
                3 => [0, 255][random as usize & 1],
                _ => random as u8,
            }
        };
        let step = if four { 4 } else { 3 };
        let stride = step * w + pad;
        // Not a byte behind the last pixel.
        let data: Vec<u8> = (0..stride * h - pad).map(value).collect();
        let frame = if four { Frame::bgra8 } else { Frame::rgb8 }(&data, w, h, stride).expect("frame");
        let fov = FieldOfView::shorter_side(degrees);
        let baseline = prepared(&frame, size, &fov);
        for simd in Level::ALL.into_iter().filter_map(|level| Simd::for_level(level).ok()) {
            let got = prepared_by(&At::new(&Inline, simd), &frame, size, &fov);
            let same = got.rgb.iter().zip(&baseline.rgb).all(|(a, b)| a.to_bits() == b.to_bits());
            prop_assert!(same && got.clipped == baseline.clipped, "{:?}", simd);
        }
        Ok(())
    });
}

#[cfg(feature = "parallel")]
#[test]
fn threads_do_not_change_a_bit() {
    let data: Vec<u8> = (0..3 * 97 * 61).map(|i| (i * 37 % 251) as u8).collect();
    let frame = Frame::rgb8(&data, 97, 61, 291).expect("frame").rotated(Rotation::Cw90);
    let pool = crate::base::exec::Pool::new(3).expect("threads");
    let fov = FieldOfView::shorter_side(50.0);
    let (one, many) = (prepared(&frame, 33, &fov), prepared_by(&pool, &frame, 33, &fov));
    assert!(one.rgb == many.rgb && one.clipped == many.clipped);
}
