//! The network's input: a linear photo to int8 pixels of sRGB-encoded R, G, B, its point of the plane, and
//! whether the light's scale is known; if it is, R, G, B are divided by it first.
//!
//! A colour's code is that of image files ([`srgb_code`]): a photo that was 8-bit sRGB comes back to its own codes. Coordinates ([`COORDINATE_REACH`]) are in steps of 1/255.
use super::graph::{COORDINATE_REACH, INPUT_CHANNELS, INPUT_ZERO_POINT};
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};
use crate::frame::LinearImage;
use crate::frame::geometry::Geometry;
use crate::frame::srgb8::srgb_code;
use crate::kernels::quant::round_half_even;

fn to_i8(code: u8) -> i8 {
    code.wrapping_sub(INPUT_ZERO_POINT.unsigned_abs()).cast_signed()
}

/// x or y of a point of the plane as the network reads it, in [0,1].
pub(super) fn coordinate(place: f32) -> f32 {
    (place / COORDINATE_REACH).clamp(-1.0, 1.0).midpoint(1.0)
}

/// Code of a coordinate.
fn coordinate_code(place: f32) -> i8 {
    to_i8(round_half_even(coordinate(place) * 255.0) as u8)
}

/// Fills the input tensor `[size][size][6]`.
#[inline(never)] // tests/counts counts it by its name.
pub(super) fn run(photo: &LinearImage<'_>, exec: &dyn Executor, out: &mut [i8]) {
    let size = photo.size;
    let geometry = Geometry::new(size, photo.fov_deg);
    let row_len = size * INPUT_CHANNELS;
    let (gain, known) = photo.light_scale.map_or((1.0, to_i8(0)), |scale| (1.0 / scale, to_i8(255)));
    for_each_row_block(exec, size, ROWS_PER_BLOCK, Plane::new(out, row_len), &|rows, mut out| {
        for (y, out) in rows.zip(out.rows()) {
            let up = coordinate_code(geometry.point(y, 0).y);
            let line = |channel: usize| {
                let start = (channel * size + y) * size;
                photo.rgb.get(start..start + size).unwrap_or(&[])
            };
            let colours = line(0).iter().zip(line(1)).zip(line(2));
            let pixels = out.as_chunks_mut::<INPUT_CHANNELS>().0.iter_mut();
            for (pixel, ((&r, &g), &b)) in pixels.zip(colours) {
                let [r, g, b] = [r, g, b].map(|linear| to_i8(srgb_code(linear * gain)));
                [pixel[0], pixel[1], pixel[2]] = [r, g, b];
            }
            for (x, pixel) in out.as_chunks_mut::<INPUT_CHANNELS>().0.iter_mut().enumerate() {
                [pixel[3], pixel[4], pixel[5]] = [coordinate_code(geometry.point(y, x).x), up, known];
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use crate::frame::transfer::linear_to_srgb;
    use std::vec;

    #[test]
    fn corners_have_their_coordinates() {
        let size = 128;
        let rgb = vec![1.0; 3 * size * size];
        let clipped = vec![0; size * size];
        let photo = LinearImage::new(size, &rgb, &clipped, 43.35);
        let mut out = vec![0; size * size * 6];
        run(&photo, &Inline, &mut out);
        // Top left: x = -(1 - 1/n) tan(fov / 2) = -0.3943, y = 0.3943; 255 (0.3943 / 0.75 + 1) / 2 = 194.53, code 195.
        assert_eq!(out[..6], [127, 127, 127, -68, 67, -128]);
        let last = out.len() - 6;
        assert_eq!(out[last..], [127, 127, 127, 67, -68, -128]);
        // Wider than the coordinates reach.
        run(&LinearImage { fov_deg: 100.0, ..photo }, &Inline, &mut out);
        assert_eq!((out[3], out[4], out[last + 3], out[last + 4]), (-128, 127, 127, -128));
        // Known light: half as bright as a scale of 2 says white is, and the flag.
        run(&LinearImage { light_scale: Some(2.0), ..photo }, &Inline, &mut out);
        let half = to_i8(round_half_even(linear_to_srgb(0.5) * 255.0) as u8);
        assert_eq!(out[..6], [half, half, half, -68, 67, 127]);
    }
}
